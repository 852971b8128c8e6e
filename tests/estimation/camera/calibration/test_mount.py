"""The mount from points on the floor: what it finds, how sure it is, and which markers help."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration.homography import (
    PointNoise,
    fit_homography,
    floor_covariance,
)
from robotctl.estimation.camera.calibration.intrinsics import calibrate_lens
from robotctl.estimation.camera.calibration.mount import FOCAL, KEYS, fit_mount, focal_length
from robotctl.estimation.camera.calibration.pattern import Board, find_corners
from robotctl.estimation.camera.calibration.spread import ALLOWED, expected_errors, recommend
from robotctl.model.sensors.camera import CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.model.sensors.camera_lens import straightened
from robotctl.workbench.camera.pictures import read_picture

LENS = CameraIntrinsics(640, 480, 457.0, 452.0, 323.0, 236.0, (-0.2, 0.05, 0.001, -0.0005, 0.0))
MOUNT = CameraMount(0.15, 0.01, 0.30, 2.0, 22.0, -1.0)
CAMERA = CameraGeometry(LENS, MOUNT)
PINHOLE = CameraIntrinsics(640, 480, 457.0, 457.0, 319.5, 239.5)
SPREAD = np.array([(x, side * 0.4 * x) for x in (0.5, 0.8, 1.3, 2.0) for side in (-1.0, 1.0)])
NOISE = PointNoise(0.5)


def sheet() -> NDArray[np.float64]:
    x, y = np.meshgrid(0.6 + 0.03 * np.arange(6), 0.03 * (np.arange(9) - 4.0))
    return np.column_stack([x.ravel(), y.ravel()])


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def numbers(mount: CameraMount) -> NDArray[np.float64]:
    return np.array([getattr(mount, key) for key in KEYS])


@settings(max_examples=40)
@given(
    mount=st.builds(
        CameraMount,
        x_m=st.floats(-0.3, 0.3),
        y_m=st.floats(-0.3, 0.3),
        z_m=st.floats(0.1, 1.5),
        yaw_deg=st.floats(-180.0, 180.0),
        pitch_deg=st.floats(15.0, 75.0),
        roll_deg=st.floats(-30.0, 30.0),
    )
)
def test_exact_points_give_the_mount_back(mount: CameraMount) -> None:
    camera = CameraGeometry(LENS, mount)
    pixels = rng(1).uniform((30.0, 280.0), (600.0, 460.0), (12, 2))
    ground = camera.ground(pixels)
    pixels, ground = (each[np.isfinite(ground[:, 0])] for each in (pixels, ground))
    assume(len(ground) >= 8)
    assume(np.linalg.norm(ground - [mount.x_m, mount.y_m], axis=1).max() <= 10.0)
    found = fit_mount(LENS, ground, pixels, rng(), NOISE)
    assert found.agree.all()
    again = CameraGeometry(LENS, found.mount)
    assert again.R_base_camera == pytest.approx(camera.R_base_camera, abs=1e-6)
    assert again.t_base_camera == pytest.approx(camera.t_base_camera, abs=1e-6)


def test_a_camera_that_looks_almost_straight_down_is_found_too() -> None:
    camera = CameraGeometry(LENS, CameraMount(0.1, 0.0, 0.5, 20.0, 89.9, 0.0))
    ground = camera.ground(rng().uniform((50.0, 50.0), (590.0, 430.0), (10, 2)))
    found = fit_mount(LENS, ground, camera.project_ground(ground), rng(), NOISE)
    again = CameraGeometry(LENS, found.mount)
    assert again.R_base_camera == pytest.approx(camera.R_base_camera, abs=1e-5)


@pytest.mark.parametrize("sigma_m", [0.0, 0.002])
def test_errors_of_many_calibrations_are_as_large_as_their_covariance(sigma_m: float) -> None:
    noise = PointNoise(0.5, sigma_m)
    draw = rng(4)
    squared, covered = [], []
    for _ in range(100):
        found = fit_mount(
            LENS,
            SPREAD + sigma_m * draw.normal(size=SPREAD.shape),
            CAMERA.project_ground(SPREAD) + 0.5 * draw.normal(size=SPREAD.shape),
            draw,
            noise,
        )
        off = numbers(found.mount) - numbers(MOUNT)
        squared.append(off @ np.linalg.inv(found.P) @ off)
        covered.append(np.abs(off) <= 1.96 * np.sqrt(np.diag(found.P)))
    # Six are expected; larger residuals widen the covariance, so somewhat fewer.
    assert 3.5 < np.mean(squared) < 7.5
    # 95 % within 3.3 standard deviations of the count.
    assert np.all(np.mean(covered, axis=0) >= 0.88)
    assert np.mean(covered) >= 0.92


@pytest.mark.parametrize("pitch_deg", [89.8, 90.0])
def test_straight_down_errors_of_places_are_as_large_as_the_covariance_says(
    pitch_deg: float,
) -> None:
    camera = CameraGeometry(LENS, CameraMount(0.1, 0.0, 0.5, 20.0, pitch_deg, 0.0))
    ground = camera.ground(rng(3).uniform((50.0, 50.0), (590.0, 430.0), (8, 2)))
    seen = np.array([(60.0, 60.0), (580.0, 60.0), (320.0, 240.0), (60.0, 400.0)])
    draw, probes, squared = rng(5), camera.ground(seen), []
    for _ in range(60):
        pixels = camera.project_ground(ground) + 0.5 * draw.normal(size=ground.shape)
        found = fit_mount(LENS, ground, pixels, draw, NOISE)
        assert -90.0 <= found.mount.pitch_deg <= 90.0
        # The information of the points where the fit ended, whichever way it came there.
        J, _ = found.jacobians(ground[found.agree])
        information = np.einsum("nik,nil->kl", J, J) / 0.5**2
        widened = max(1.0, found.chi2 / found.degrees)
        assert information @ found.P == pytest.approx(widened * np.eye(6), abs=1e-4)
        C = floor_covariance(*found.jacobians(probes), found.P, 0.0)
        off = found.camera.ground(seen) - probes
        squared.append(np.einsum("ni,ni->n", off, np.linalg.solve(C, off[:, :, None])[:, :, 0]))
    assert 1.4 < np.mean(squared) < 2.4


def test_the_jacobians_of_the_fit_tell_how_pixels_move() -> None:
    found = fit_mount(LENS, SPREAD, CAMERA.project_ground(SPREAD), rng(), NOISE)
    by_keys, by_ground = found.jacobians(SPREAD)
    higher = CameraGeometry(LENS, replace(found.mount, z_m=found.mount.z_m + 1e-6))
    slope = (higher.project_ground(SPREAD) - found.camera.project_ground(SPREAD)) / 1e-6
    assert by_keys[:, :, 2] == pytest.approx(slope, rel=1e-3)
    moved = found.camera.project_ground(SPREAD + np.array([0.0, 1e-6]))
    slope = (moved - found.camera.project_ground(SPREAD)) / 1e-6
    assert by_ground[:, :, 1] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_the_lens_makes_the_mount_better_far_away_than_the_homography_alone() -> None:
    probe = np.array([[2.5, 0.0]])
    pixels = CAMERA_PINHOLE.project_ground(sheet())
    found = fit_mount(PINHOLE, sheet(), pixels, rng(), NOISE)
    plain = fit_homography(sheet(), pixels, NOISE)
    by_lens = floor_covariance(*found.jacobians(probe), found.P, 0.0)
    by_points = floor_covariance(*plain.jacobians(probe), plain.P, 0.0)
    assert np.trace(by_points[0]) > 4.0 * np.trace(by_lens[0])


CAMERA_PINHOLE = CameraGeometry(PINHOLE, MOUNT)


def test_without_a_lens_the_focal_length_is_found_within_its_interval() -> None:
    draw = rng(6)
    inside = 0
    for _ in range(40):
        pixels = CAMERA_PINHOLE.project_ground(SPREAD) + 0.3 * draw.normal(size=SPREAD.shape)
        found = fit_mount(PINHOLE, SPREAD, pixels, draw, PointNoise(0.3), lens_known=False)
        assert found.keys == (*KEYS, FOCAL)
        assert found.intrinsics.fx_px == found.intrinsics.fy_px
        inside += abs(found.intrinsics.fx_px - 457.0) <= 1.96 * found.sigma[FOCAL]
    assert inside >= 34


@given(pitch_deg=st.floats(10.0, 70.0), roll_deg=st.floats(-20.0, 20.0), yaw=st.floats(-90.0, 90.0))
def test_an_exact_homography_implies_the_focal_length(
    pitch_deg: float, roll_deg: float, yaw: float
) -> None:
    camera = CameraGeometry(PINHOLE, CameraMount(0.1, 0.0, 0.4, yaw, pitch_deg, roll_deg))
    assert focal_length(camera.homography(), PINHOLE) == pytest.approx(457.0)


def test_straight_down_the_focal_length_cannot_be_told() -> None:
    camera = CameraGeometry(PINHOLE, CameraMount(0.1, 0.0, 0.5, 0.0, 90.0, 0.0))
    ground = camera.ground(rng().uniform((50.0, 50.0), (590.0, 430.0), (10, 2)))
    pixels = camera.project_ground(ground) + 0.3 * rng().normal(size=(10, 2))
    with pytest.raises(ValueError, match="do not determine the focal length"):
        fit_mount(PINHOLE, ground, pixels, rng(), NOISE, lens_known=False)


def test_a_point_written_down_wrong_is_named_and_does_no_harm() -> None:
    pixels = CAMERA.project_ground(SPREAD) + 0.3 * rng().normal(size=SPREAD.shape)
    wrong = SPREAD.copy()
    wrong[3, 1] *= -1.0
    found = fit_mount(LENS, wrong, pixels, rng(), NOISE)
    assert np.flatnonzero(~found.agree).tolist() == [3]
    assert np.linalg.norm(found.residuals_px[3]) > 50.0
    assert found.mount.pitch_deg == pytest.approx(MOUNT.pitch_deg, abs=0.5)


def test_left_and_right_exchanged_is_refused_with_what_to_look_at() -> None:
    with pytest.raises(ValueError, match="is y to the left"):
        fit_mount(LENS, SPREAD * [1.0, -1.0], CAMERA.project_ground(SPREAD), rng(), NOISE)


def test_residuals_larger_than_the_noise_widen_the_intervals() -> None:
    pixels = CAMERA.project_ground(SPREAD)
    calm = fit_mount(LENS, SPREAD, pixels, rng(), PointNoise(1.0))
    rough = fit_mount(
        LENS, SPREAD, pixels + 2.0 * rng(8).normal(size=SPREAD.shape), rng(), PointNoise(1.0)
    )
    assert rough.chi2 > 1.5 * rough.degrees
    assert rough.sigma["pitch_deg"] > 1.2 * calm.sigma["pitch_deg"]


def test_the_expected_error_is_the_one_of_many_calibrations() -> None:
    draw = rng(9)
    found = fit_mount(LENS, sheet(), CAMERA.project_ground(sheet()), draw, NOISE)
    expected = {each.range_m: each for each in expected_errors(found, 0.5)}
    bearings = np.linspace(-math.pi, math.pi, 181)[1:]
    points = 2.0 * np.column_stack([np.cos(bearings), np.sin(bearings)]) + [0.15, 0.01]
    seen = CAMERA.project_ground(points)
    points, seen = (each[CAMERA.inside(seen)] for each in (points, seen))
    squared = []
    for _ in range(100):
        pixels = CAMERA.project_ground(sheet()) + 0.5 * draw.normal(size=sheet().shape)
        camera = fit_mount(LENS, sheet(), pixels, draw, NOISE).camera
        squared.append(np.mean(np.sum((camera.ground(seen) - points) ** 2, axis=1)))
    assert math.sqrt(np.mean(squared)) == pytest.approx(expected[2.0].calibration_m, rel=0.25)
    noisy = CAMERA.ground(seen + 0.5 * draw.normal(size=seen.shape)) - points
    assert math.sqrt(np.mean(np.sum(noisy**2, axis=1))) == pytest.approx(
        expected[2.0].pixel_m, rel=0.25
    )


def test_a_sheet_near_the_robot_is_not_enough_and_the_advice_makes_it_enough() -> None:
    found = fit_mount(LENS, sheet(), CAMERA.project_ground(sheet()), rng(), NOISE)
    assert not expected_errors(found, 0.5)[-1].enough
    advice = recommend(found, NOISE)
    assert advice is not None
    more = np.vstack([sheet(), advice.markers])
    again = fit_mount(LENS, more, CAMERA.project_ground(more), rng(), NOISE)
    for promised, got in zip(advice.expected, expected_errors(again, 0.5), strict=True):
        assert got.calibration_m == pytest.approx(promised.calibration_m, rel=0.05)
    assert max(each.calibration_m / each.range_m for each in advice.expected) <= ALLOWED
    assert recommend(again, NOISE) is None


def test_all_places_of_the_advice_are_in_the_picture() -> None:
    few = SPREAD[[0, 1, 2, 3]]
    found = fit_mount(LENS, few, CAMERA.project_ground(few), rng(), PointNoise(1.0))
    advice = recommend(found, PointNoise(1.0, 0.003))
    assert advice is not None
    assert advice.markers
    assert CAMERA.inside(CAMERA.project_ground(np.array(advice.markers))).all()


@pytest.mark.recordings("camera")
def test_one_side_of_a_real_board_tells_where_the_other_side_is(recordings: Path) -> None:
    board = Board(9, 6, 0.025)
    files = sorted((recordings / "camera").glob("left*.jpg"))
    seen = [find_corners(read_picture(file), board) for file in files]
    corners = [each for each in seen if each is not None]
    assert len(corners) == 13
    lens = calibrate_lens(corners, board, 640, 480).intrinsics
    left = board.corners()[:, 1] > 0.02
    by_mount, by_points = [], []
    for pixels in corners:
        places = board.corners()
        found = fit_mount(lens, places[left], pixels[left], rng(), PointNoise(0.15))
        straight = straightened(pixels, lens)
        plain = fit_homography(places[left], straight[left], PointNoise(0.15))
        for errors, told in (
            (by_mount, found.camera.ground(pixels[~left])),
            (by_points, plain.ground(straight[~left])),
        ):
            off = told - places[~left]
            errors.append(math.sqrt(np.mean(np.sum(off * off, axis=1))))
    # A board of 225 mm, 0.15 px at about 0.7 mm a pixel.
    assert np.median(by_mount) < 0.4e-3
    assert np.median(by_points) < 0.8e-3
