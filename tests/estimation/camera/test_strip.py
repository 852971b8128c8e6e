"""The strip against the camera's geometry, sample by sample."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.strip import ABOVE_HORIZON_ROWS, GroundStrip
from robotctl.model.sensors.camera import CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry
from tests.estimation.camera.camera_pictures import LENS

MOUNTS = [
    CameraMount(0.1, 0.0, 0.3, 0.0, 20.0, 0.0),
    CameraMount(-0.05, 0.12, 0.5, 25.0, 35.0, -4.0),
    CameraMount(0.0, 0.0, 0.2, -170.0, 12.0, 3.0),
]


def strip_of(mount: CameraMount, **settings: float) -> GroundStrip:
    return GroundStrip(CameraGeometry(LENS, mount), GroundCameraConfig(**settings))


def pixels_of(strip: GroundStrip, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return where in the picture samples of a strip are to be looked up, (n, 2) [px]."""
    down, bearing = strip.depression_rad[rows], strip.bearings_rad[columns]
    level = np.cos(down)
    ways = np.stack([level * np.cos(bearing), level * np.sin(bearing), -np.sin(down)], axis=1)
    return strip.camera.project(strip.camera.t_base_camera + ways)


@pytest.mark.parametrize("mount", MOUNTS)
def test_each_sample_lies_on_the_floor_where_its_row_and_column_say(mount: CameraMount) -> None:
    strip = strip_of(mount)
    rows, columns = np.nonzero(strip.seen[: strip.horizon_row - 20])
    some = np.random.default_rng(1).choice(len(rows), 300)
    rows, columns = rows[some], columns[some]
    ground = strip.camera.ground(pixels_of(strip, rows, columns))
    offset = ground - strip.camera.t_base_camera[:2]
    assert np.hypot(*offset.T) == pytest.approx(strip.ranges_m[rows], rel=1e-6)
    turn = np.arctan2(offset[:, 1], offset[:, 0]) - strip.bearings_rad[columns]
    assert np.cos(turn) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("mount", MOUNTS)
def test_columns_are_evenly_apart(mount: CameraMount) -> None:
    strip = strip_of(mount)
    assert np.diff(strip.bearings_rad) == pytest.approx(-strip.column_rad, rel=1e-9)
    assert len(strip.bearings_rad) == LENS.width_px // 2


@pytest.mark.parametrize("mount", MOUNTS)
def test_what_is_looked_up_is_what_the_picture_shows_there(mount: CameraMount) -> None:
    strip = strip_of(mount)
    v, u = np.mgrid[0 : LENS.height_px, 0 : LENS.width_px]
    picture = np.stack([u * 0.7, v, 0.3 * (u + v)], axis=2).round().astype(np.uint8)
    looked = strip.look(picture).astype(float)
    rows, columns = np.nonzero(strip.seen)
    pixels = pixels_of(strip, rows, columns)
    mean = (looked[rows, 2 * columns] + looked[rows, 2 * columns + 1]) / 2
    x, y = pixels.T
    expected = np.stack([0.7 * x, y, 0.3 * (x + y)], axis=1)
    inside = (x > 1) & (x < LENS.width_px - 2) & (y > 1) & (y < LENS.height_px - 2)
    assert np.abs(mean - expected)[inside].max() < 1.2


def test_rows_are_a_pixel_apart_where_it_matters() -> None:
    strip = strip_of(MOUNTS[0])
    middle = len(strip.bearings_rad) // 2
    far = np.flatnonzero((strip.ranges_m > 1.0) & np.isfinite(strip.ranges_m))
    steps = np.diff(pixels_of(strip, far, np.full(len(far), middle)), axis=0)
    assert np.hypot(*steps.T) == pytest.approx(1.0, abs=0.02)
    assert strip.pixel_rows[far[5:-5], middle] == pytest.approx(1.0, abs=0.05)


def test_the_strip_reaches_a_little_above_the_horizon() -> None:
    strip = strip_of(MOUNTS[0])
    above = strip.depression_rad[strip.horizon_row :]
    assert len(above) == pytest.approx(28, abs=4)
    steep = CameraMount(0.1, 0.0, 0.3, 0.0, 8.0, 0.0)
    assert np.sum(strip_of(steep).depression_rad <= 0.0) == ABOVE_HORIZON_ROWS
    assert np.all(above <= 1e-9)
    assert np.all(np.isinf(strip.ranges_m[strip.horizon_row :]))


def test_the_free_patch_is_a_trapezoid_on_the_floor() -> None:
    strip = strip_of(MOUNTS[1], patch_near_width_m=0.2, patch_far_width_m=0.5, patch_depth_m=0.3)
    rows, columns = np.nonzero(strip.patch)
    ground = strip.camera.ground(pixels_of(strip, rows, columns))
    corners = strip.patch_outline_base()
    following = np.roll(corners, -1, axis=0)
    # Left of each side, walking along the outline clockwise: all crosses of one sign.
    side, offset = following - corners, ground[:, None] - corners
    cross = side[:, 0] * offset[..., 1] - side[:, 1] * offset[..., 0]
    assert np.all(cross <= 1e-3)
    assert np.hypot(*(corners[0] - corners[3])) == pytest.approx(0.2)
    assert np.hypot(*(corners[1] - corners[2])) == pytest.approx(0.5)


def test_two_coarse_rows_are_no_higher_than_the_least_obstacle() -> None:
    strip = strip_of(MOUNTS[0], least_height_m=0.04)
    h, judged = strip.height_m, 0
    for low, high in zip(strip.edges[:-1], strip.edges[1:], strict=True):
        range_m = strip.ranges_m[low]
        if range_m > 1.5:
            break
        rises_m = h - range_m * math.tan(strip.depression_rad[high])
        assert rises_m < 0.04 / 2 + 0.006
        judged += 1
    assert judged >= 3


def test_a_camera_without_a_horizon_in_sight_looks_at_the_floor_alone() -> None:
    strip = strip_of(CameraMount(0.0, 0.0, 0.4, 0.0, 60.0, 0.0))
    assert strip.horizon_row == len(strip.depression_rad)
    assert np.all(np.isfinite(strip.ranges_m))


@pytest.mark.parametrize(
    ("mount", "message"),
    [
        (CameraMount(0.0, 0.0, 0.3, 0.0, -60.0, 0.0), "height 0.3 m, pitch -60.0 deg down"),
        (CameraMount(0.0, 0.0, 0.01, 0.0, -24.0, 0.0), "height 0.01 m, pitch -24.0 deg down"),
    ],
)
def test_a_camera_that_sees_too_little_floor_is_refused(mount: CameraMount, message: str) -> None:
    with pytest.raises(ValueError, match=f"the camera sees no floor ahead: {message}"):
        strip_of(mount)


def test_a_free_patch_of_few_samples_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the free patch has only \d+ samples of the picture"):
        strip_of(MOUNTS[0], patch_depth_m=0.001)


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(240, 320, 3\).*found \(480, 640, 3\)"):
        strip_of(MOUNTS[0]).look(np.zeros((480, 640, 3), np.uint8))
    with pytest.raises(ValueError, match="float64"):
        strip_of(MOUNTS[0]).look(np.zeros((240, 320, 3)))  # type: ignore[arg-type]
