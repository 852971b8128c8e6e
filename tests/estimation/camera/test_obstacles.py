"""Things of which foot, width and height are known, and walls that are none."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from robotctl.estimation.camera.boundary import FOUND, FREE, UNCLEAR, Boundary
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.obstacles import GroundObstacle, find_obstacles
from robotctl.estimation.camera.scan import column_ranges
from robotctl.estimation.camera.strip import GroundStrip
from tests.estimation.camera.camera_pictures import CAMERA, MOUNT

CONFIG = GroundCameraConfig()
STRIP = GroundStrip(CAMERA, CONFIG)
COLUMNS, CELLS = len(STRIP.bearings_rad), len(STRIP.edges) - 1
TURNS = STRIP.bearings_rad


def seen(
    ranges_m: np.ndarray,
    height_m: float = 0.12,
    kinds: np.ndarray | None = None,
    *,
    as_wall: bool = False,
) -> tuple[GroundObstacle, ...]:
    """What is found where columns end at ranges, each with a thing of one height."""
    rows = np.interp(-ranges_m, -STRIP.ranges_m[::-1], np.arange(len(STRIP.ranges_m))[::-1])
    found = np.isfinite(ranges_m)
    kinds = np.where(found, FOUND, FREE) if kinds is None else kinds
    cells = np.clip(np.searchsorted(STRIP.edges, rows, side="right") - 1, 0, CELLS - 1)
    evidence = np.full((CELLS, COLUMNS), -2.0, np.float32)
    for c in np.flatnonzero(found):
        top = math.atan2(STRIP.height_m - height_m, ranges_m[c])
        ends = np.searchsorted(STRIP.edges, np.sum(STRIP.depression_rad > top), side="left")
        evidence[cells[c] : ends, c] = 2.0
    boundary = Boundary(
        kinds.astype(np.int8), cells, np.where(found, rows, np.nan), np.where(found, 0.1, np.nan)
    )
    columns = column_ranges(STRIP, boundary, CONFIG)
    floor = np.full_like(evidence, -2.0)
    both = (floor, evidence) if as_wall else (evidence, floor)
    return find_obstacles(STRIP, boundary, columns, *both, CONFIG)


def disc(x_m: float, y_m: float, radius_m: float) -> np.ndarray:
    """Ranges to a round thing from below the camera; inf beside it."""
    dx, dy = x_m - MOUNT.x_m, y_m - MOUNT.y_m
    along = dx * np.cos(TURNS) + dy * np.sin(TURNS)
    inside = radius_m**2 - (dx**2 + dy**2 - along**2)
    with np.errstate(invalid="ignore"):
        return np.where(inside > 0.0, along - np.sqrt(inside), np.inf)


@pytest.mark.parametrize(("x", "y", "r"), [(1.1, 0.0, 0.05), (1.5, 0.4, 0.12), (2.0, -0.3, 0.04)])
def test_a_round_thing_is_where_it_is(x: float, y: float, r: float) -> None:
    (found,) = seen(disc(x, y, r))
    offset = np.array([x - MOUNT.x_m, y - MOUNT.y_m])
    nearest = [MOUNT.x_m, MOUNT.y_m] + offset * (1.0 - r / np.hypot(*offset))
    assert found.foot_base == pytest.approx(nearest, abs=0.015)
    assert found.width_m == pytest.approx(2.0 * r, abs=0.02)
    error = found.centre_base - [x, y]
    assert error @ np.linalg.solve(found.centre_covariance, error) < 9.0
    assert not found.cut


def test_the_uncertainty_of_the_foot_is_long_along_the_line_of_sight() -> None:
    (found,) = seen(disc(1.8, 0.9, 0.06))
    along = found.foot_base - [MOUNT.x_m, MOUNT.y_m]
    along /= np.hypot(*along)
    across = np.array([-along[1], along[0]])
    P = found.foot_covariance
    assert pytest.approx(P.T) == P
    assert along @ P @ along > across @ P @ across
    assert along @ P @ across == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("height_m", [0.08, 0.2])
def test_a_things_height_is_seen_unless_it_ends_above_the_horizon(height_m: float) -> None:
    (found,) = seen(disc(1.2, 0.1, 0.06), height_m)
    assert found.height_m == pytest.approx(height_m, abs=0.02)
    (found,) = seen(disc(1.2, 0.1, 0.06), 0.6)
    assert math.isinf(found.height_m)


def test_a_wall_is_no_obstacle_and_a_thing_before_it_is_one() -> None:
    wall = (2.2 - MOUNT.x_m) / np.cos(TURNS)
    assert seen(wall, 2.0) == ()
    (found,) = seen(np.minimum(wall, disc(1.4, 0.2, 0.08)))
    assert found.foot_base[0] == pytest.approx(1.32, abs=0.03)


def test_two_things_are_two() -> None:
    found = seen(np.minimum(disc(1.2, 0.25, 0.05), disc(1.5, -0.2, 0.1)))
    assert [each.foot_base[0] for each in found] == pytest.approx([1.15, 1.4], abs=0.02)


def test_what_is_too_low_too_narrow_or_too_far_is_left_out() -> None:
    assert seen(disc(1.2, 0.0, 0.05), 0.01) == ()
    assert seen(disc(1.2, 0.0, 0.008)) == ()
    assert seen(disc(2.9, 0.0, 0.1)) == ()
    assert dataclasses.asdict(CONFIG)["obstacle_range_m"] < 2.9


def test_what_the_picture_cuts_is_reported_as_cut_if_its_top_is_in_sight() -> None:
    ranges = np.full(COLUMNS, np.inf)
    kinds = np.full(COLUMNS, FREE)
    ranges[:12], kinds[:12] = 1.0, FOUND
    (found,) = seen(ranges, kinds=kinds)
    assert found.cut
    assert seen(ranges, 2.0, kinds) == ()


def test_pieces_of_a_wall_that_is_hardly_told_from_the_floor_are_no_things() -> None:
    ranges = np.where(np.abs(TURNS) < 0.08, 1.5, np.nan)
    kinds = np.where(np.isnan(ranges), UNCLEAR, FOUND)
    assert seen(ranges, 2.0, kinds, as_wall=True) == ()
    assert len(seen(ranges, 2.0, kinds)) == 1
