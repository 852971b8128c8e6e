"""Beams against a textbook loop, and their stated noise against drawn errors."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.camera.boundary import BLOCKED, FOUND, FREE, UNCLEAR, UNSEEN, Boundary
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.scan import ColumnRanges, beam_scan, column_ranges
from robotctl.estimation.camera.strip import GroundStrip
from robotctl.model.sensors.camera import CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry
from tests.estimation.camera.camera_pictures import CAMERA, LENS, MOUNT

CONFIG = GroundCameraConfig(beams=7)
STRIP = GroundStrip(CAMERA, CONFIG)
COLUMNS = len(STRIP.bearings_rad)


def boundary_at(range_m: float, kind: int = FOUND, noise_rows: float = 0.0) -> Boundary:
    """The same boundary in all columns."""
    row = np.interp(-range_m, -STRIP.ranges_m[::-1], np.arange(len(STRIP.ranges_m))[::-1])
    return Boundary(
        np.full(COLUMNS, kind, np.int8),
        np.zeros(COLUMNS, np.intp),
        np.full(COLUMNS, float(row)),
        np.full(COLUMNS, noise_rows),
    )


@pytest.mark.parametrize("range_m", [0.6, 1.3, 2.9])
def test_stated_noise_is_that_of_drawn_pixels_pitches_and_heights(range_m: float) -> None:
    rng = np.random.default_rng(1)
    config = dataclasses.replace(CONFIG, boundary_sigma_px=1.0, pitch_sigma_deg=0.15)
    stated = column_ranges(STRIP, boundary_at(range_m), config)
    middle = COLUMNS // 2
    bearing = STRIP.bearings_rad[middle]
    foot = CAMERA.t_base_camera[:2]
    point = foot + range_m * np.array([math.cos(bearing), math.sin(bearing)])
    pixel = CAMERA.project_ground(point[None])[0]
    found = []
    angle_deg = math.hypot(config.pitch_sigma_deg, config.calibration_sigma_deg)
    for _ in range(1500):
        # The robot believes its mount; the true one differs.
        true = CameraMount(
            MOUNT.x_m,
            MOUNT.y_m,
            MOUNT.z_m * (1.0 + config.height_sigma * rng.normal()),
            0.0,
            MOUNT.pitch_deg + angle_deg * rng.normal(),
            0.0,
        )
        seen = CameraGeometry(LENS, true).project_ground(point[None])[0]
        seen[1] += config.boundary_sigma_px * rng.normal()
        found.append(np.hypot(*(CAMERA.ground(seen[None])[0] - foot)))
    sigma = math.hypot(stated.own_m[middle], stated.common_m[middle])
    assert sigma == pytest.approx(float(np.std(found)), rel=0.12)
    assert CAMERA.ground(pixel[None])[0] == pytest.approx(point, abs=1e-6)


def test_ranges_are_those_of_the_rows_and_nothing_stands_for_nothing() -> None:
    assert column_ranges(STRIP, boundary_at(1.7), CONFIG).ranges_m == pytest.approx(1.7, rel=1e-3)
    free = column_ranges(STRIP, boundary_at(1.7, FREE), CONFIG)
    assert np.all(np.isinf(free.ranges_m))
    assert np.all(np.isnan(free.own_m))
    for kind in (UNSEEN, UNCLEAR):
        assert np.all(np.isnan(column_ranges(STRIP, boundary_at(1.7, kind), CONFIG).ranges_m))


def test_a_blocked_column_says_before_the_first_floor_in_sight() -> None:
    judged = STRIP.first_rows < STRIP.horizon_row
    assert judged.sum() > 100
    kinds = np.where(judged, BLOCKED, UNSEEN).astype(np.int8)
    boundary = dataclasses.replace(boundary_at(1.7), kinds=kinds)
    blocked = column_ranges(STRIP, boundary, CONFIG)
    nearest = STRIP.ranges_m[STRIP.first_rows[judged]]
    assert blocked.ranges_m[judged] == pytest.approx(nearest)
    # Anything from the camera on is within three sigma.
    assert 3.0 * blocked.own_m[judged] == pytest.approx(nearest)


def test_beyond_its_reach_nothing_is_measured() -> None:
    near = dataclasses.replace(CONFIG, max_range_m=1.5)
    far = column_ranges(STRIP, boundary_at(1.7), near)
    assert np.all(np.isinf(far.ranges_m))


def textbook_beams(columns: ColumnRanges, beams: int) -> list[tuple[float, float]]:
    """Range and sigma of the beams, left first, column by column."""
    edges = np.linspace(0, COLUMNS, beams + 1).astype(int)
    result = []
    for first, end in itertools.pairwise(edges):
        r = [x for x in columns.ranges_m[first:end] if not math.isnan(x)]
        if 2 * len(r) <= end - first:
            result.append((math.nan, math.nan))
        elif min(r) == math.inf:
            result.append((math.inf, math.nan))
        else:
            near = [k for k in range(first, end) if columns.ranges_m[k] <= 1.1 * min(r)]
            values = columns.ranges_m[near]
            sigma = np.hypot(columns.own_m[near], columns.common_m[near]).mean()
            result.append((values.mean(), math.hypot(sigma, values.std())))
    return result


@given(seed=st.integers(0, 10_000))
def test_beams_are_those_of_a_textbook_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ranges = rng.choice([0.8, 0.84, 2.0, math.inf, math.nan], COLUMNS)
    block = rng.integers(0, COLUMNS - 30)
    ranges[block : block + 30] = rng.choice([math.nan, math.inf, 1.0])
    sigmas = np.where(np.isfinite(ranges), rng.uniform(0.01, 0.1, COLUMNS), math.nan)
    columns = ColumnRanges(ranges, sigmas, 0.5 * sigmas, ranges)
    scan = beam_scan(STRIP, columns, 5, CONFIG)
    expected = np.array(textbook_beams(columns, CONFIG.beams))[::-1]
    assert scan.ranges_m == pytest.approx(expected[:, 0], nan_ok=True)
    assert scan.sigmas_m == pytest.approx(expected[:, 1], nan_ok=True)


def test_the_fan_starts_below_the_camera_and_goes_counter_clockwise() -> None:
    scan = beam_scan(STRIP, column_ranges(STRIP, boundary_at(1.7), CONFIG), 77, CONFIG)
    assert (scan.x_m, scan.y_m) == (MOUNT.x_m, MOUNT.y_m)
    assert scan.stamp_ns == 77
    assert np.all(np.diff(scan.angles_rad) > 0.0)
    assert np.hypot(*(scan.points_base() - [MOUNT.x_m, MOUNT.y_m]).T) == pytest.approx(
        1.7, rel=1e-3
    )
