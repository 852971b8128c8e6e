"""Tables of points as spreadsheets write them, and what is said of those that are read wrongly."""

import pytest

from robotctl.errors import ConfigError
from robotctl.workbench.camera.points import read_columns


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("u;v\n1.5;2.5\n", r"a\.csv:1: the columns are separated by ';'; needed are commas"),
        ("u;v;n\n1,5;2,5;a\n", "numbers have decimal commas; needed are commas and decimal p"),
        ("# seen\nu\tv\n1.5\t2.5\n", r"a\.csv:2: the columns are separated by tabs"),
        ("u v\n1.5 2.5\n", r"a\.csv:1: the columns are separated by spaces"),
        ('u,v\n"1,5","2,5"\n', r"a\.csv:2: u: found '1,5', with a decimal comma, a finite number"),
        ("u,v\n1,5,2,5\n", r"a\.csv:2: 4 cells, the heading has 2; are there decimal commas\?"),
        ("u,v\n1.5\n", r"a\.csv:2: v: 1 cells in the line, a finite number is needed"),
        ("u,w\n1.5,2.5\n", r"a\.csv:1: no column v"),
    ],
)  # fmt: skip
def test_a_table_of_another_kind_is_called_by_its_name(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_columns(tmp_path / "a.csv", ("u", "v"))


@pytest.mark.parametrize("text", ["u,v\n1,2\n", '"u","v",\n1,2,\n', "\ufeffn, v, u\na,2,1\n"])
def test_commas_are_what_is_read(tmp_path, text):
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    assert read_columns(tmp_path / "a.csv", ("u", "v")).tolist() == [[1.0, 2.0]]
