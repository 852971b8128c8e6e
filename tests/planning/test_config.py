"""Settings of planning and of the floor camera: each is bounded, named when wrong, and counts."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.config import NavigationConfig
from robotctl.planning.map.config import MapConfig, TracksConfig
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.map.tracks import MovingObstacles

BODY = Footprint(((0.2, -0.18), (0.2, 0.18), (-0.2, 0.18), (-0.2, -0.18)))


def numbers_of(table):
    """Yield each number of a table and of those in it: its table's class, and its name."""
    for each in fields(table):
        value = getattr(table, each.name)
        if is_dataclass(value):
            yield from numbers_of(value)
        elif isinstance(value, int | float):
            yield type(table), each.name


NAVIGATION, CAMERA = NavigationConfig(), GroundCameraConfig()
TABLES = (
    NAVIGATION.pilot,
    NAVIGATION.map,
    NAVIGATION.follow,
    NAVIGATION.guard.memory,
    NAVIGATION.guard.approach,
    NAVIGATION.journey.rungs,
    NAVIGATION.journey.exploration,
    NAVIGATION.journey.travel,
    CAMERA.floor,
    CAMERA.boundary,
    CAMERA.objects,
)
ALL = [each for table in TABLES for each in numbers_of(table)]


@pytest.mark.parametrize(("table", "key"), ALL, ids=[f"{t.__name__}.{key}" for t, key in ALL])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e9])
def test_no_setting_takes_a_number_that_means_nothing(table, key, value):
    with pytest.raises(ValueError, match=key):
        table(**{key: value})


@pytest.mark.parametrize(
    ("setting", "found"),
    [
        ("navigation.map.tracks.gate_m=6", r"navigation\.map\.tracks\.gate_m: 6.* 0\.01 to 5 allo"),
        (
            "navigation.map.around_m=5",
            r"navigation\.map\.around_m: 5.* lidar_range_m \(10.0\)",
        ),
        ("navigation.follow.tau_s=0.05", r"navigation\.follow\.tau_s: 0\.05 found, .* rate_hz"),
        ("navigation.guard.memory.life_s=0", r"guard\.memory\.life_s: 0.* found, 0\.5 to 3600"),
        ("ground_camera.objects.behind_columns=9", r"behind_columns: 9 found, 1 to 8 allowed"),
    ],
)
def test_a_robots_file_is_told_the_key_the_value_and_the_range(setting, found):
    with pytest.raises(ConfigError, match=found):
        load_robot(find_file("diff_drive"), [setting])


def test_a_lidars_points_are_marked_up_to_the_range_that_the_file_says():
    grid = GridMap(np.zeros((60, 120), np.int8), 0.1)
    here, scan = SE2(1.0, 3.0, 0.0), RangeScan(0, np.array([0.0, 0.01]), np.array([6.0, 6.0]), 12.0)

    def marks(config):
        live = LayeredMap(grid, BODY, config)
        live.see_scan(here, scan, 0)
        return len(live.marked_world())

    assert marks(MapConfig()) > 0
    assert marks(MapConfig(lidar_range_m=5.0)) == 0


def test_a_walker_slower_than_the_file_says_does_not_move():
    """0.8 m/s ahead of the sensor, before a wall."""
    angles = np.linspace(-0.8, 0.8, 321)

    def speeds(config):
        obstacles = MovingObstacles(config)
        for step in range(30):
            y = -1.2 + 0.08 * step
            cos, sin = np.cos(angles), np.sin(angles)
            along, aside = 2.0 * cos + y * sin, -2.0 * sin + y * cos
            inside = 0.25**2 - aside**2
            hit = along - np.sqrt(np.maximum(inside, 0.0))
            ranges = np.where(inside > 0.0, hit, 4.0 / cos)
            obstacles.step(SE2(), RangeScan(0, angles, ranges, 10.0), 100_000_000 * (step + 1))
        return np.hypot(*obstacles.moving(SE2())[:, 2:4].T)

    assert speeds(TracksConfig()) == pytest.approx([0.8], abs=0.1)
    assert len(speeds(replace(TracksConfig(), speed_min_m_s=1.2))) == 0
