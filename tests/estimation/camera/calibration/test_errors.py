"""The error analysis, the view from above, boards and lenses: against closed forms and truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.camera.calibration.errors import bands, floor_errors
from robotctl.estimation.camera.calibration.floor import (
    FloorWindow,
    draw_grid,
    draw_points,
    view_from_above,
)
from robotctl.estimation.camera.calibration.homography import PointNoise
from robotctl.estimation.camera.calibration.intrinsics import KEYS, calibrate_lens
from robotctl.estimation.camera.calibration.pattern import Board, draw_board, find_corners
from robotctl.model.sensors.camera import CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry

LENS = CameraIntrinsics(640, 480, 457.0, 452.0, 323.0, 236.0, (-0.2, 0.05, 0.001, -0.0005, 0.0))
CAMERA = CameraGeometry(LENS, CameraMount(0.15, 0.0, 0.30, 0.0, 22.0, 0.0))
GROUND = np.array([(x, side * 0.3 * x) for x in (0.5, 0.9, 1.6, 2.5) for side in (-1.0, 1.0)])


def test_a_camera_that_is_lower_than_calibrated_tells_all_too_far_in_proportion() -> None:
    lower = CameraGeometry(LENS, CameraMount(0.15, 0.0, 0.27, 0.0, 22.0, 0.0))
    errors = floor_errors(CAMERA, GROUND, lower.project_ground(GROUND), PointNoise())
    # Similar triangles: told over true distance is 0.30 over 0.27.
    assert errors.off_m[:, 0] == pytest.approx(errors.range_m * (0.30 / 0.27 - 1.0))
    assert errors.off_m[:, 1] == pytest.approx(0.0, abs=1e-9)
    found = bands(errors)
    assert [(band.low_m, band.count) for band in found] == [(0.0, 4), (1.0, 2), (2.0, 2)]
    assert all(band.surprising for band in found)
    assert found[2].bias_m[0] == pytest.approx(errors.off_m[6:, 0].mean())
    assert found[2].rmse_m == pytest.approx(errors.off_m[6, 0])


def test_a_camera_turned_left_of_its_calibration_tells_all_to_the_right() -> None:
    turned = CameraGeometry(LENS, CameraMount(0.15, 0.0, 0.30, 2.0, 22.0, 0.0))
    errors = floor_errors(CAMERA, GROUND, turned.project_ground(GROUND), PointNoise())
    assert errors.off_m[:, 1] == pytest.approx(-errors.range_m * math.sin(math.radians(2.0)))


def test_errors_by_noise_are_as_large_as_expected() -> None:
    rng = np.random.default_rng(1)
    noise = PointNoise(0.5, 0.002)
    total, surprising = [], 0
    for _ in range(100):
        places = GROUND + 0.002 * rng.normal(size=GROUND.shape)
        pixels = CAMERA.project_ground(places) + 0.5 * rng.normal(size=GROUND.shape)
        errors = floor_errors(CAMERA, GROUND, pixels, noise)
        total.append(errors.chi2)
        surprising += sum(band.surprising for band in bands(errors))
    assert np.mean(total) == pytest.approx(2.0, abs=0.3)
    assert surprising <= 5


def test_what_is_above_the_horizon_is_in_no_band() -> None:
    pixels = np.vstack([CAMERA.project_ground(GROUND[:1]), [[320.0, 2.0]]])
    errors = floor_errors(CAMERA, GROUND[:2], pixels, PointNoise())
    assert np.isnan(errors.chi2[1])
    assert [band.count for band in bands(errors)] == [1]


def test_from_above_a_square_on_the_floor_is_a_square_of_its_size() -> None:
    u, v = np.meshgrid(np.arange(640.0), np.arange(480.0))
    floor = CAMERA.ground(np.column_stack([u.ravel(), v.ravel()]))
    inside = np.all(np.abs(floor - [1.0, 0.1]) < 0.15, axis=1).reshape(480, 640)
    picture = np.repeat(np.where(inside, 255, 80).astype(np.uint8)[:, :, None], 3, axis=2)
    view = FloorWindow(0.5, 1.5, 0.5, 0.01)
    above = view_from_above(picture, CAMERA, view)
    assert above.shape == (100, 100, 3)
    rows, columns = np.nonzero(above[:, :, 0] > 160)
    assert len(rows) == pytest.approx(30 * 30, rel=0.05)
    points = view.points().reshape(100, 100, 2)[rows, columns]
    assert points.mean(axis=0) == pytest.approx((1.0, 0.1), abs=0.01)
    column, row = view.pixel_of(1.0, 0.1)
    assert tuple(view.points().reshape(100, 100, 2)[row, column]) == pytest.approx(
        (1.0, 0.1), abs=0.0051
    )
    plain = above.copy()
    draw_grid(above, view)
    draw_points(above, view, np.array([[1.0, 0.1], [9.0, 9.0], [np.nan, 0.0]]))
    assert np.any(above != plain)


def test_a_board_turned_by_half_is_the_same_in_another_order() -> None:
    board = Board(9, 6, 0.03)
    corners = board.corners()
    orders = board.turned(corners)
    assert len(orders) == 2
    assert orders[1] == pytest.approx(-corners)
    assert len(Board(5, 5, 0.03).turned(Board(5, 5, 0.03).corners())) == 4
    assert tuple(corners[0]) == pytest.approx((2.5 * 0.03, 4.0 * 0.03))


def test_corners_of_a_drawn_board_are_where_they_were_drawn() -> None:
    board = Board(8, 5, 0.01)
    grey = draw_board(board)
    picture = np.repeat(grey[:, :, None], 3, axis=2)
    found = find_corners(picture, board)
    assert found is not None
    middle = np.array([grey.shape[1] - 1, grey.shape[0] - 1]) / 2.0
    # Ten pixels a millimetre; u to the right is -y, v down is -x.
    expected = middle - 10_000.0 * board.corners()[:, ::-1]
    off = [np.abs(order - expected).max() for order in board.turned(found)]
    assert min(off) < 0.1
    assert find_corners(np.zeros_like(picture), board) is None


def lens_pictures(count: int, noise_px: float, *, tilted: bool = True) -> list[np.ndarray]:
    """Return corners of a board held before the lens in many ways."""
    rng = np.random.default_rng(3)
    board = Board(9, 6, 0.025)
    flat = np.column_stack([board.corners(), np.zeros(54)])
    pictures = []
    while len(pictures) < count:
        angles = rng.uniform(-0.6, 0.6, 3) if tilted else np.array([0.0, 0.0, rng.uniform(-3, 3)])
        mount = CameraMount(0.0, 0.0, rng.uniform(0.3, 0.45), 0.0, 90.0, 0.0)
        camera = CameraGeometry(LENS, mount)
        (a, b, c), (sa, sb, sc) = np.cos(angles), np.sin(angles)
        R = (
            np.array([[1, 0, 0], [0, a, -sa], [0, sa, a]])
            @ np.array([[b, 0, sb], [0, 1, 0], [-sb, 0, b]])
            @ np.array([[c, -sc, 0], [sc, c, 0], [0, 0, 1]])
        )
        pixels = camera.project(flat @ R.T + [*rng.uniform(-0.1, 0.1, 2), 0.0])
        if camera.inside(pixels).all():
            pictures.append(pixels + noise_px * rng.normal(size=pixels.shape))
    return pictures


def test_a_lens_is_found_within_its_intervals() -> None:
    found = calibrate_lens(lens_pictures(12, 0.2), Board(9, 6, 0.025), 640, 480)
    truth = np.array([457.0, 452.0, 323.0, 236.0, *LENS.distortion])
    assert len(KEYS) == len(truth)
    # All nine at 95 % are allowed one miss, by half of its width.
    off = np.abs(found.values - truth) / found.half_width
    assert np.sum(off > 1.0) <= 1
    assert off.max() < 1.5
    assert found.half_width[0] < 5.0
    assert np.sqrt(np.mean(found.rms_px**2)) == pytest.approx(0.2, rel=0.1)


def test_a_picture_with_wrong_corners_is_left_out() -> None:
    pictures = lens_pictures(10, 0.1)
    pictures[4] = pictures[4] + np.random.default_rng(1).normal(scale=3.0, size=(54, 2))
    found = calibrate_lens(pictures, Board(9, 6, 0.025), 640, 480)
    assert np.flatnonzero(np.isnan(found.rms_px)).tolist() == [4]
    assert found.intrinsics.fx_px == pytest.approx(457.0, rel=0.01)


def test_a_board_that_is_never_tilted_does_not_tell_the_focal_length() -> None:
    with pytest.raises(ValueError, match="tilt the board"):
        calibrate_lens(lens_pictures(6, 0.3, tilted=False), Board(9, 6, 0.025), 640, 480)
    with pytest.raises(ValueError, match="3 pictures with the board; 4 are needed"):
        calibrate_lens(lens_pictures(3, 0.1), Board(9, 6, 0.025), 640, 480)


def test_too_few_pictures_that_fit_are_refused_as_too_few_pictures_are() -> None:
    pictures = lens_pictures(4, 0.1)
    pictures[3] = pictures[3] + np.random.default_rng(1).normal(scale=3.0, size=(54, 2))
    with pytest.raises(ValueError, match="3 pictures of 4 with the board fit each other; 4 are"):
        calibrate_lens(pictures, Board(9, 6, 0.025), 640, 480)


def test_corners_that_no_lens_shows_are_an_error_that_says_so() -> None:
    one_place = [np.full((54, 2), 100.0)] * 5
    with pytest.raises(ValueError, match="OpenCV finds no lens that shows the board so"):
        calibrate_lens(one_place, Board(9, 6, 0.025), 640, 480)


def test_a_view_without_pixels_is_refused() -> None:
    for wrong, message in (
        ({"far_m": -1.0}, "near_m 0 must be less than far_m -1"),
        ({"half_width_m": 0.0}, "half_width_m must be > 0, not 0"),
        ({"m_per_px": 0.0}, "m_per_px must be > 0, not 0"),
        ({"m_per_px": 1e-6}, "3000000 x 3000000 pixels of 1e-06 m; allowed are 1 to 8000"),
    ):
        with pytest.raises(ValueError, match=message):
            FloorWindow(**wrong)
