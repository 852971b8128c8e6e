"""The table of killed mutants."""

import tomllib
from pathlib import Path

import pytest

from mutants import row, table, tally

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mutmut"]
RESULTS = [
    "    robotctl.safety.health.xǁHealthǁupdate__mutmut_1: killed",
    "    robotctl.safety.health.xǁHealthǁupdate__mutmut_2: survived",
    "    robotctl.safety.health.x_is_fresh__mutmut_1: timeout",
    "    robotctl.safety.health.x_is_fresh__mutmut_2: no tests",
    "    robotctl.control.limiter.x_step__mutmut_1: killed",
    "    robotctl.control.limiter.x_step__mutmut_2: not checked",
]


def test_each_module_has_a_row_and_what_no_test_noticed_counts_as_survived():
    assert table(tally(RESULTS)).splitlines()[2:] == [
        "| `robotctl.control.limiter` | 1 | 1 | 0 | 100.0% |",
        "| `robotctl.safety.health` | 4 | 2 | 2 | 50.0% |",
        "| all | 5 | 3 | 2 | 60.0% |",
    ]


def test_a_status_of_tomorrow_does_not_count_as_killed():
    found = tally(["    a.b.x_c__mutmut_1: segfault", "    a.b.x_c__mutmut_2: suspicious"])
    assert row("b", found["a.b"]) == "| b | 2 | 0 | 2 | 0.0% |"


@pytest.mark.parametrize("key", ["only_mutate", "pytest_add_cli_args_test_selection"])
def test_every_file_of_the_settings_is_there(key):
    assert SETTINGS[key]
    assert [name for name in SETTINGS[key] if not (ROOT / name).is_file()] == []
