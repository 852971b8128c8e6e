"""The table of results, read back by pyarrow and compared with the lines of JSON."""

import sys

import pytest

from robotctl.errors import ConfigError
from robotctl.workbench.campaign.parquet import TABLE, write_parquet
from robotctl.workbench.campaign.results import Head
from tests.workbench.campaign.reports import head, result

RESULTS = [
    result(1, True, {"gain": 1, "sensors": ["lidar"], "seed": 1}, time_s=2.5, plans=3),
    result(2, False, {"gain": 0.5, "sensors": "none", "seed": 2}, time_s=7, arrived=True),
    result(3, None, {"gain": 0.5, "sensors": "none", "seed": 3}),
]


def read(folder):
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra campaign has pyarrow")
    return parquet.read_table(folder / TABLE)


def test_the_table_has_what_the_lines_have_each_in_its_type(tmp_path):
    write_parquet(tmp_path, head(3, "mission_completed = true", "time_s <= 5"), RESULTS)
    table = read(tmp_path)
    rows = table.to_pylist()
    assert [row["number"] for row in rows] == [1, 2, 3]
    assert [row["passed"] for row in rows] == [True, False, None]
    assert [row["gain"] for row in rows] == [1.0, 0.5, 0.5]
    assert [row["sensors"] for row in rows] == ['["lidar"]', "none", "none"]
    assert [row["mission_completed = true"] for row in rows] == [True, False, None]
    assert [row["time_s <= 5"] for row in rows] == [True, False, None]
    assert rows[1]["reason"] == "mission_completed = false, not = true; time_s = 7, not <= 5"
    assert rows[2]["reason"] == "killed"
    for row, each in zip(rows, RESULTS, strict=True):
        for name, value in row.items():
            if name.startswith("report."):
                assert value == (each.report or {}).get(name.removeprefix("report."))
    kinds = {name: str(table.schema.field(name).type) for name in table.column_names}
    assert (kinds["seed"], kinds["report.plans"]) == ("int64", "int64")
    assert (kinds["report.time_s"], kinds["report.arrived"]) == ("double", "bool")
    assert "report.real_time_factor" not in kinds


def test_the_same_results_give_the_same_bytes(tmp_path):
    write_parquet(tmp_path, head(3), RESULTS)
    before = (tmp_path / TABLE).read_bytes()
    write_parquet(tmp_path, head(3), RESULTS)
    assert (tmp_path / TABLE).read_bytes() == before


def test_a_case_is_asked_for_its_own_criteria_alone(tmp_path):
    both = Head("c", "0", "s", "f", 2, ("collisions = 0",), {"own": ("plans <= 2",)})
    results = [
        result_of_case("", collisions=0, plans=3),
        result_of_case("own", collisions=1, plans=1),
    ]
    write_parquet(tmp_path, both, results)
    rows = read(tmp_path).to_pylist()
    assert [(row["collisions = 0"], row["plans <= 2"]) for row in rows] == [
        (True, None),
        (None, True),
    ]


def result_of_case(case, **fields):
    return result(1, True, {"case": case, "seed": 1}, **fields)


def test_without_pyarrow_it_is_said_which_extra_has_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigError, match="the extra `campaign` has it"):
        write_parquet(tmp_path, head(3), RESULTS)
    assert not (tmp_path / TABLE).exists()
