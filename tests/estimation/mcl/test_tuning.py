"""Settings of the particles in a robot's file: each is bounded, named when wrong, and counts."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.mcl.likelihood_monitor import LikelihoodMonitor
from robotctl.estimation.mcl.map_symmetry import symmetries
from robotctl.estimation.mcl.misfit import Misfit
from robotctl.estimation.mcl.search_size import search_size, too_large
from robotctl.estimation.mcl.tuning import MonitorConfig, SearchConfig
from robotctl.model.grid_map import GridMap


def settings_of(table):
    """Yield each number of a table and of those in it: its table's class, and its name."""
    for each in fields(table):
        value = getattr(table, each.name)
        if is_dataclass(value):
            yield from settings_of(value)
        else:
            yield type(table), each.name


LOCALISATION = LocalisationConfig()
ALL = [*settings_of(LOCALISATION.mcl), *settings_of(LOCALISATION.slam)]


@pytest.mark.parametrize(("table", "key"), ALL, ids=[key for _, key in ALL])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e9])
def test_no_setting_takes_a_number_that_means_nothing(table, key, value):
    with pytest.raises(ValueError, match=key):
        table(**{key: value})


@pytest.mark.parametrize(
    ("setting", "found"),
    [
        ("mcl.search.apart_m=0.0", r"localisation\.mcl\.search\.apart_m: 0\.0 found, 0\.01 to 10"),
        ("mcl.monitor.slack=11", r"localisation\.mcl\.monitor\.slack: 11.* found, 0 to 10 allowed"),
        (
            "mcl.search.particles_min=6000000",
            r"search\.particles_min: .* particles_max \(5000000\)",
        ),
        ("slam.rest_s=-1", r"localisation\.slam\.rest_s: -1.* found, 0 to 10000 allowed"),
        ("grid.occupied_above=0.4", r"localisation\.grid\.occupied_above: must lie in \(0\.5, 1\)"),
        ("lidar.hidden_likelihood=0", r"localisation\.lidar\.hidden_likelihood: must be in \(0, 1"),
    ],
)
def test_a_robots_file_is_told_the_key_the_value_and_the_range(setting, found):
    with pytest.raises(ConfigError, match=found):
        load_robot(find_file("diff_drive"), [f"localisation.{setting}"])


def test_a_robots_file_sets_them():
    few = load_robot(find_file("diff_drive"), ["localisation.mcl.search.particles_per_m2=20"])
    assert search_size(2000.0, few.localisation.mcl.search) == 40_000
    assert too_large(6600.0, few.localisation.mcl.search) is None


def test_a_monitor_with_a_higher_alarm_bears_more():
    def first_alarm(monitor):
        return next((k for k in range(200) if monitor.is_bad(-20.0, -5.0)), None)

    early, late = MonitorConfig(alarm=4.0), MonitorConfig(alarm=16.0)
    assert first_alarm(LikelihoodMonitor(early)) < first_alarm(LikelihoodMonitor(late))
    never = MonitorConfig(alarm=1e6, alarm_alone=1e6)
    assert first_alarm(LikelihoodMonitor(never)) is None


def test_a_map_that_may_fit_badly_is_never_the_wrong_one():
    strict, lenient = Misfit(), Misfit(SearchConfig(fit_min=-100.0))
    for _ in range(20):
        strict.add(-20.0)
        lenient.add(-20.0)
    assert (strict.is_bad, lenient.is_bad) == (True, False)


def test_a_symmetry_needs_the_share_of_the_walls_that_the_file_says():
    # Three of the four walls of a room: turned by half a turn, two of them fall on walls.
    cells = np.zeros((60, 60), np.int8)
    cells[5, 5:55] = cells[54, 5:55] = cells[5:55, 5] = 100
    grid = GridMap(cells, 0.2)
    turned = [len(symmetries(grid, SearchConfig(symmetry_min=least))) for least in (0.05, 0.99)]
    assert turned[0] > turned[1]
