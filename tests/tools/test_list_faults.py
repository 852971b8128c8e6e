"""The page on faults lists those that there are."""

import re
import tomllib

import pytest
from list_faults import BEGIN, END, TARGET, listed_in

from firmware_sim.fault_catalogue import CATALOGUE
from firmware_sim.faults import check
from firmware_sim.scenario import load_scenario

PAGE = TARGET.read_text(encoding="utf-8")


def test_the_page_shows_the_present_catalogue():
    assert listed_in(PAGE) == PAGE, "run .venv/bin/python tools/list_faults.py"


def test_every_kind_has_a_row_with_all_its_parameters_and_no_other_has():
    rows = dict(re.findall(r"^\| `(\w+)` \| .* \| (.*) \|$", PAGE, re.MULTILINE))
    assert set(rows) == set(CATALOGUE)
    for name, kind in CATALOGUE.items():
        defaults = re.findall(r"`(\w+)=([^`]*)`", rows[name])
        assert [key for key, _ in defaults] == list(kind.parameters)
        assert check(name, dict(defaults))[1] == kind.complete({})


def test_the_examples_of_the_page_are_right(tmp_path):
    [example] = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert len(tomllib.loads(example)["fault"]) == 2
    path = tmp_path / "example.toml"
    path.write_text(example, encoding="utf-8")
    load_scenario(path)
    for line in re.search(r"```\n(encoder.*?)clear\n```", PAGE, re.DOTALL)[1].splitlines():
        name, *words = line.split()
        check(name, dict(word.split("=") for word in words))


@pytest.mark.parametrize("text", ["no marks", BEGIN, f"{BEGIN}{END}{BEGIN}"])
def test_a_page_without_its_marks_is_refused(text):
    with pytest.raises(ValueError, match="once each"):
        listed_in(text)
