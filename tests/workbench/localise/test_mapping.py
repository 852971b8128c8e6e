from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.estimation.grid.map_quality import map_quality
from robotctl.maps.map_file import load_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap
from robotctl.workbench.localise.map_options import MapOptions
from robotctl.workbench.localise.mapping import make_map

ROOM = WallMap(np.array([[-2, -1.5, 3, -1.5], [3, -1.5, 3, 2], [3, 2, -2, 2], [-2, 2, -2, -1.5]]))


def ranges_of(pose):
    """Return what a SICK of 180 beams reads in the rectangular room."""
    angles = np.radians(np.arange(-90, 90)) + pose.theta_rad
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        x = np.where(c > 0, (3 - pose.x_m) / c, (-2 - pose.x_m) / c)
        y = np.where(s > 0, (2 - pose.y_m) / s, (-1.5 - pose.y_m) / s)
    return np.minimum(x, y)


def write_log(path, lines=24, shift=0.0):
    """Write a CARMEN log of a robot that turns in the room; its odometry is off by `shift`."""
    text = []
    for k in range(lines):
        pose = SE2(0.5 * math.cos(k), 0.3 * math.sin(k), 2.4 * k % 6.0 - 3.0)
        ranges = " ".join(f"{each:.3f}" for each in ranges_of(pose))
        reference = f"{pose.x_m:.6f} {pose.y_m:.6f} {pose.theta_rad:.6f}"
        odometry = f"{pose.x_m + shift:.6f} {pose.y_m:.6f} {pose.theta_rad:.6f}"
        text.append(f"FLASER 180 {ranges} {reference} {odometry} {k}.0 robot {k}.0")
    path.write_text("\n".join(text) + "\n")
    return path


@pytest.mark.parametrize(("scans", "used"), [("all", 24), ("even", 12), ("odd", 12)])
def test_a_log_becomes_a_map_of_its_room_at_the_reference_poses(tmp_path, scans, used):
    log = write_log(tmp_path / "room.log", shift=7.0)
    seen = []
    result = make_map(
        MapOptions(log, tmp_path / "map", scans), lambda done, of: seen.append((done, of))
    )
    assert (result.used, result.of, result.from_reference) == (used, 24, True)
    assert seen[-1] == (used, used)
    grid = load_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(grid.cells, result.grid.cells)
    assert grid.origin == result.grid.origin
    quality = map_quality(grid, ROOM)
    assert quality.precision > 0.98
    assert quality.recall > 0.9
    assert result.figures.seen_m2 == pytest.approx(5.0 * 3.5, rel=0.1)


def test_even_and_odd_scans_are_different_scans(tmp_path):
    log = write_log(tmp_path / "room.log", lines=2)
    even = make_map(MapOptions(log, tmp_path / "even", "even")).grid
    odd = make_map(MapOptions(log, tmp_path / "odd", "odd")).grid
    assert even.cells.shape != odd.cells.shape or np.any(even.cells != odd.cells)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scans": "evn"}, '--scans evn: unknown; did you mean "even"'),
        ({"scans": "odd"}, "1 lidar scans in it, none of them in --scans odd"),
        ({"resolution_m": 0.0}, r"--resolution 0: .*found 0.0"),
        ({"prefix": "nowhere/map"}, "the folder .*nowhere does not exist"),
        ({"resolution_m": 2e-4}, r"scans 0 to 0: a grid of .* at most"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path, change, message):
    log = write_log(tmp_path / "room.log", lines=1)
    options = {"log": log, "prefix": tmp_path / "map", **change}
    options["prefix"] = tmp_path / options["prefix"]
    with pytest.raises(ConfigError, match=message):
        make_map(MapOptions(**options))
    assert not list(tmp_path.glob("map*"))


@pytest.mark.recordings("carmen/intel-odometry.log.gz")
def test_the_two_halves_of_the_intel_log_give_the_same_building(tmp_path, recordings):
    log = recordings / "carmen" / "intel-odometry.log.gz"
    even, odd = (
        make_map(MapOptions(log, tmp_path / which, which)).grid for which in ("even", "odd")
    )
    points = odd.centre_of(np.argwhere(odd.free()))
    at = even.cell_of(points)
    inside = np.all((at >= 0) & (at < even.cells.shape), axis=1)
    other = even.cells[tuple(at[inside].T)]
    known = other >= 0
    assert known.mean() > 0.85
    assert (other[known] == 0).mean() > 0.99
    assert np.count_nonzero(even.free()) * 0.05**2 > 350.0
