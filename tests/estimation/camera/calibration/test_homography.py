"""The floor homography: against OpenCV, textbook loops, numerical derivatives and its own noise."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import least_squares

from robotctl.estimation.camera.calibration.homography import (
    Homography,
    PointNoise,
    find_homography,
    fit_homography,
    floor_covariance,
)
from robotctl.model.sensors.camera import CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry

LENS = CameraIntrinsics(640, 480, 457.0, 457.0, 319.5, 239.5)
CAMERA = CameraGeometry(LENS, CameraMount(0.15, 0.0, 0.30, 3.0, 22.0, 1.0))
FAR = np.array([[0.5, 0.2], [0.6, -0.2], [1.0, 0.5], [1.1, -0.4], [1.6, 0.0], [2.0, 0.6]])


def board(columns: int = 9, rows: int = 6, side_m: float = 0.03) -> NDArray[np.float64]:
    x, y = np.meshgrid(0.6 + side_m * np.arange(rows), side_m * (np.arange(columns) - 4.0))
    return np.column_stack([x.ravel(), y.ravel()])


def unit(H: NDArray[np.float64]) -> NDArray[np.float64]:
    return H / np.linalg.norm(H)


def test_exact_points_give_the_homography_of_the_camera() -> None:
    for ground in (FAR, FAR[:4], board()):
        found = fit_homography(ground, CAMERA.project_ground(ground))
        # With this sign: the third coordinate of what the camera sees is how far ahead it is.
        assert np.abs(found.H - unit(CAMERA.homography())).max() < 1e-10
        assert found.degrees == 2 * len(ground) - 8
        assert found.chi2 == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=50)
@given(
    mount=st.builds(
        CameraMount,
        x_m=st.floats(-0.3, 0.3),
        y_m=st.floats(-0.3, 0.3),
        z_m=st.floats(0.1, 1.0),
        yaw_deg=st.floats(-180.0, 180.0),
        pitch_deg=st.floats(15.0, 85.0),
        roll_deg=st.floats(-30.0, 30.0),
    ),
    seed=st.integers(0, 1000),
)
def test_noisy_points_give_the_least_residuals_as_opencv_and_scipy_do(
    mount: CameraMount, seed: int
) -> None:
    camera = CameraGeometry(LENS, mount)
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((20.0, 200.0), (620.0, 460.0), (15, 2))
    ground = camera.ground(pixels)
    near = np.linalg.norm(ground - camera.t_base_camera[:2], axis=1) < 20.0 * mount.z_m
    ground, pixels = ground[near], pixels[near] + rng.normal(scale=0.3, size=(near.sum(), 2))
    assume(near.sum() >= 8)
    ours = fit_homography(ground, pixels)
    H = cv2.findHomography(ground, pixels)[0]
    expected = cv2.perspectiveTransform(ground[None], H)[0]
    cost = np.sum(ours.residuals_px**2)
    # OpenCV stops after ten steps, so its minimum may be higher.
    assert cost <= np.sum((pixels - expected) ** 2) * (1.0 + 1e-9)
    assert ours.pixels(ground) == pytest.approx(expected, abs=1.0)

    def residuals(h: NDArray[np.float64]) -> NDArray[np.float64]:
        return (cv2.perspectiveTransform(ground[None], h.reshape(3, 3))[0] - pixels).ravel()

    start = (H / np.linalg.norm(H)).ravel()
    other = least_squares(residuals, start, x_scale=np.abs(start) + 1e-3, xtol=1e-12, ftol=1e-12)
    assert cost <= 2.0 * other.cost * (1.0 + 1e-6)


def test_the_horizon_through_the_origin_is_no_special_case() -> None:
    # The last entry of H is 0 where the origin is in the plane of the camera's x and y.
    x_m = 0.30 * math.tan(math.radians(22.0))
    camera = CameraGeometry(LENS, CameraMount(x_m, 0.0, 0.30, pitch_deg=22.0))
    assert camera.homography()[2, 2] == pytest.approx(0.0, abs=1e-12)
    ground = FAR
    pixels = camera.project_ground(ground)
    found = fit_homography(ground, pixels)
    assert found.H[2, 2] == pytest.approx(0.0, abs=1e-9)
    assert found.ground(pixels) == pytest.approx(ground, abs=1e-9)


def test_the_inverse_maps_back_and_knows_the_horizon() -> None:
    found = fit_homography(FAR, CAMERA.project_ground(FAR))
    assert found.ground(found.pixels(FAR)) == pytest.approx(FAR)
    assert np.isnan(found.ground(np.array([[320.0, 10.0]]))).all()
    assert np.isnan(found.pixels(np.array([[-1.0, 0.0]]))).all()


def test_the_jacobians_are_the_numerical_ones() -> None:
    found = fit_homography(FAR, CAMERA.project_ground(FAR))
    by_H, by_ground = found.jacobians(FAR)
    step = 1e-7
    for k in range(9):
        change = np.zeros(9)
        change[k] = step
        above, below = (
            Homography(found.H + sign * change.reshape(3, 3), found.P, found.residuals_px, 0.0)
            for sign in (1.0, -1.0)
        )
        slope = (above.pixels(FAR) - below.pixels(FAR)) / (2.0 * step)
        assert by_H[:, :, k] == pytest.approx(slope, rel=1e-4, abs=1e-2)
    for k in range(2):
        move = np.eye(2)[k] * 1e-6
        slope = (found.pixels(FAR + move) - found.pixels(FAR - move)) / 2e-6
        assert by_ground[:, :, k] == pytest.approx(slope, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("sigma_m", [0.0, 0.003])
def test_covariance_and_chi2_are_those_of_many_noisy_fits(sigma_m: float) -> None:
    rng = np.random.default_rng(3)
    ground = np.vstack([FAR, board()[::6]])
    pixels = CAMERA.project_ground(ground)
    noise = PointNoise(0.4, sigma_m)
    truth = fit_homography(ground, pixels, noise)
    probe = CAMERA.project_ground(np.array([[0.8, 0.1], [1.5, -0.3]]))
    found, chi2 = [], []
    for _ in range(400):
        fit = fit_homography(
            ground + sigma_m * rng.normal(size=ground.shape),
            pixels + 0.4 * rng.normal(size=pixels.shape),
            noise,
        )
        found.append(fit.ground(probe))
        chi2.append(fit.chi2)
    off = np.array(found) - CAMERA.ground(probe)
    _, P = truth.ground_covariance(probe, 0.0)
    squared = np.einsum("kni,nij,knj->kn", off, np.linalg.inv(P), off)
    low, high = stats.chi2.ppf((0.001, 0.999), 2 * 400) / 400
    # Linearised: a tenth of slack on top.
    assert np.all(squared.mean(axis=0) > 0.9 * low)
    assert np.all(squared.mean(axis=0) < 1.1 * high)
    low, high = stats.chi2.ppf((0.001, 0.999), 400 * truth.degrees) / 400
    assert 0.97 * low < np.mean(chi2) < 1.03 * high


def test_the_covariance_of_a_pixel_adds_to_that_of_the_homography() -> None:
    found = fit_homography(FAR, CAMERA.project_ground(FAR))
    pixel = CAMERA.project_ground(np.array([[1.0, 0.0]]))
    ground, both = found.ground_covariance(pixel, 0.7)
    _, alone = found.ground_covariance(pixel, 0.0)
    _, of_pixel = CAMERA.ground_covariance(pixel, 0.7)
    assert both == pytest.approx(alone + of_pixel, rel=1e-6)
    assert np.isnan(found.ground_covariance(np.array([[320.0, 0.0]]), 1.0)[1]).all()
    by_H, by_ground = found.jacobians(ground)
    assert floor_covariance(by_H, by_ground, np.zeros((9, 9)), 0.7) == pytest.approx(of_pixel)


@pytest.mark.parametrize("wrong", [1, 4, 8])
def test_wrong_points_are_found_and_left_out(wrong: int) -> None:
    rng = np.random.default_rng(wrong)
    ground = np.column_stack([rng.uniform(0.5, 2.0, 20), rng.uniform(-0.4, 0.4, 20)])
    pixels = CAMERA.project_ground(ground) + rng.normal(scale=0.3, size=(20, 2))
    bad = rng.permutation(20)[:wrong]
    pixels[bad] += rng.uniform(15.0, 60.0, (wrong, 2)) * rng.choice((-1.0, 1.0), (wrong, 2))
    found, agree = find_homography(ground, pixels, rng, PointNoise(0.5))
    assert not agree[bad].any()
    assert agree.sum() >= 20 - wrong - 1
    kept = fit_homography(ground[agree], pixels[agree], PointNoise(0.5))
    assert np.allclose(found.H, kept.H)


def test_points_exchanged_are_told_from_the_others() -> None:
    ground = np.vstack([FAR, [[0.7, 0.0], [1.3, 0.3]]])
    pixels = CAMERA.project_ground(ground)
    pixels[[1, 5]] = pixels[[5, 1]]
    _, agree = find_homography(ground, pixels, np.random.default_rng(1))
    assert agree.tolist() == [True, False, True, True, True, False, True, True]


def test_too_few_that_agree_are_refused() -> None:
    pixels = CAMERA.project_ground(FAR[:5])
    pixels[2] += 25.0
    with pytest.raises(ValueError, match="only 4 of 5 points agree"):
        find_homography(FAR[:5], pixels, np.random.default_rng(1))


def test_the_search_is_repeatable_by_its_seed() -> None:
    rng = np.random.default_rng(5)
    pixels = CAMERA.project_ground(board()) + rng.normal(scale=0.5, size=(54, 2))
    once, again = (find_homography(board(), pixels, np.random.default_rng(2))[0] for _ in "ab")
    assert np.array_equal(once.H, again.H)


SQUARE = np.array([[0.5, 0.2], [0.5, -0.2], [1.0, 0.3], [1.0, -0.3]])
LINE = np.column_stack([np.linspace(0.5, 1.5, 6), np.linspace(-0.2, 0.3, 6)])


@pytest.mark.parametrize(
    ("ground", "words"),
    [
        (SQUARE[:3], "3 points; a homography needs 4"),
        (SQUARE[[0, 1, 2, 2]], "only 3 different points on the floor"),
        (LINE, "all points on the floor lie on a line"),
        (np.vstack([LINE, [[1.0, -0.4]]]), "all points on the floor but one lie on a line"),
        (
            np.vstack([LINE, [[1.0, -0.4], [1.0, -0.4]]]),
            "all points on the floor but one lie on a line",
        ),
    ],
)
@pytest.mark.parametrize("noise_px", [0.0, 0.5])
def test_geometry_that_determines_nothing_is_refused_with_its_reason(
    ground: NDArray[np.float64], words: str, noise_px: float
) -> None:
    pixels = CAMERA.project_ground(ground)
    pixels += noise_px * np.random.default_rng(1).normal(size=pixels.shape)
    with pytest.raises(ValueError, match=words):
        fit_homography(ground, pixels)
    if len(ground) > 4:
        with pytest.raises(ValueError, match=words):
            find_homography(ground, pixels, np.random.default_rng(1))


def test_points_nearly_on_a_line_are_refused_by_what_the_pixels_are_worth() -> None:
    ground = np.vstack([LINE, LINE[[0, 5]] + [0.01, -0.01]])
    pixels = CAMERA.project_ground(ground)
    with pytest.raises(ValueError, match=r"picture \(to 1 px\) but one lie on a line"):
        fit_homography(ground, pixels, PointNoise(1.0))
    assert fit_homography(ground, pixels, PointNoise(0.01)).ground(pixels) == pytest.approx(ground)


def test_points_nearer_to_each_other_than_pixels_tell_are_refused() -> None:
    ground = 0.1 * SQUARE + np.array([1.5, 0.0])
    with pytest.raises(ValueError, match="too near to each other"):
        fit_homography(ground, CAMERA.project_ground(ground), PointNoise(1.0))


def test_pixels_on_a_line_are_refused() -> None:
    pixels = np.column_stack([np.linspace(10.0, 600.0, 4), [200.0, 200.1, 199.9, 200.0]])
    with pytest.raises(ValueError, match=r"in the picture \(to 0.5 px\) lie on a line"):
        fit_homography(SQUARE, pixels)


def test_points_that_no_camera_can_see_so_are_refused() -> None:
    pixels = CAMERA.project_ground(SQUARE)
    with pytest.raises(ValueError, match="no camera can see these points like this"):
        fit_homography(SQUARE, pixels[[1, 0, 2, 3]])


def test_wrong_arrays_are_refused() -> None:
    pixels = CAMERA.project_ground(SQUARE)
    with pytest.raises(ValueError, match=r"must both be \(n, 2\)"):
        fit_homography(SQUARE, pixels[:3])
    with pytest.raises(ValueError, match="must be finite"):
        fit_homography(SQUARE, np.where(pixels > 300.0, np.nan, pixels))
    with pytest.raises(ValueError, match="sigma_px must be > 0"):
        PointNoise(0.0)


def test_accuracy_on_the_floor_is_that_of_opencv() -> None:
    # Half a pixel of noise, eight markers spread to 2 m; benchmarks/camera_homography.py has more.
    rng = np.random.default_rng(7)
    ground = np.array([(x, side * 0.4 * x) for x in (0.45, 0.8, 1.3, 2.0) for side in (-1, 1)])
    probe = np.array([(x, side * x) for x in (0.7, 1.5, 2.5) for side in (-0.4, 0.0, 0.4)])
    seen = CAMERA.project_ground(probe)
    ours, theirs = [], []
    for _ in range(100):
        pixels = CAMERA.project_ground(ground) + rng.normal(scale=0.5, size=(8, 2))
        ours.append(fit_homography(ground, pixels).ground(seen) - probe)
        H = np.linalg.inv(cv2.findHomography(ground, pixels)[0])
        theirs.append(cv2.perspectiveTransform(seen[None], H)[0] - probe)
    ours_m, theirs_m = (np.sqrt(np.mean(np.square(off), axis=0)) for off in (ours, theirs))
    assert np.all(ours_m <= 1.01 * theirs_m)
