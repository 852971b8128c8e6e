"""Pictures that were turned by half a turn give no lens in silence: they are found and named."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from robotctl.config.robot_file import find_file
from robotctl.errors import CalibrationError
from robotctl.estimation.camera.calibration.intrinsics import TurnedPicturesError, calibrate_lens
from robotctl.estimation.camera.calibration.pattern import Board
from robotctl.workbench.camera.calibrate import calibrate_camera
from robotctl.workbench.camera.options import CameraCalibrateOptions
from robotctl.workbench.camera.pictures import read_picture, write_picture

BOARD = Board(9, 6, 0.025)
SIZE = (640, 480)
FAR = np.array(SIZE) - 1.0


def pictures(cx: float, cy: float, seed: int) -> list[np.ndarray]:
    """Return corners as OpenCV projects tilted boards into a camera with this optical centre."""
    rng = np.random.default_rng(seed)
    K = np.array([[530.0, 0.0, cx], [0.0, 532.0, cy], [0.0, 0.0, 1.0]])
    flat = np.column_stack([BOARD.corners() * (1.0, -1.0), np.zeros(54)])
    seen = []
    while len(seen) < 8:
        about = rng.uniform(0.0, 2.0 * np.pi)
        rotation = 0.55 * np.array([np.cos(about), np.sin(about), 0.3])
        place = (*rng.uniform(-0.12, 0.12, 2), rng.uniform(0.3, 0.45))
        pixels = cv2.projectPoints(flat, rotation, np.array(place), K, np.zeros(5))[0][:, 0]
        if np.all((pixels > 5.0) & (pixels < FAR - 5.0)):
            seen.append(pixels + rng.normal(0.0, 0.1, pixels.shape))
    return seen


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("turned", [{2, 5}, {1, 4, 6}, {0, 2, 3, 4, 5, 7}])
def test_those_that_are_fewer_are_named_on_whichever_side_the_lens_looks(turned, side):
    seen = pictures(319.5 + 25.0 * side, 229.5, 7)
    given = [FAR - each if k in turned else each for k, each in enumerate(seen)]
    with pytest.raises(TurnedPicturesError) as refused:
        calibrate_lens(given, BOARD, *SIZE)
    assert {*refused.value.numbers} == (turned if len(turned) < 4 else {*range(8)} - turned)


def test_a_single_one_fits_so_badly_that_it_is_left_out():
    seen = pictures(344.5, 229.5, 7)
    lens = calibrate_lens([*seen[:-1], FAR - seen[-1]], BOARD, *SIZE)
    assert np.isnan(lens.rms_px).tolist() == [False] * 7 + [True]
    assert lens.intrinsics.cx_px == pytest.approx(344.5, abs=1.5)


def test_pictures_that_are_all_turned_have_the_lens_of_a_camera_upside_down():
    seen = pictures(344.5, 229.5, 7)
    upright = calibrate_lens(seen, BOARD, *SIZE).intrinsics
    turned = calibrate_lens([FAR - each for each in seen], BOARD, *SIZE).intrinsics
    assert upright.cx_px == pytest.approx(344.5, abs=1.5)
    assert (turned.cx_px, turned.cy_px) == pytest.approx(
        (639.0 - upright.cx_px, 479.0 - upright.cy_px), abs=0.01
    )


def test_a_lens_in_the_middle_of_the_picture_has_no_wrong_side():
    given = [FAR - each if k % 2 else each for k, each in enumerate(pictures(319.5, 239.5, 3))]
    lens = calibrate_lens(given, BOARD, *SIZE).intrinsics
    assert (lens.cx_px, lens.cy_px) == pytest.approx((319.5, 239.5), abs=1.0)


@pytest.mark.recordings("camera")
def test_real_pictures_some_of_which_were_turned_are_refused_by_name(
    recordings: Path, tmp_path: Path
) -> None:
    given = []
    for number, path in enumerate(sorted((recordings / "camera").glob("left*.jpg"))):
        if number not in (3, 6, 9):
            given.append(path)
            continue
        given.append(tmp_path / f"turned{number}.png")
        write_picture(given[-1], np.ascontiguousarray(np.rot90(read_picture(path), 2)))
    options = CameraCalibrateOptions(find_file("diff_drive"), lens=tuple(given), square_mm=25.0)
    with pytest.raises(
        CalibrationError, match=r"^turned3\.png, turned6\.png, turned9\.png: turned by half a"
    ):
        calibrate_camera(options, lambda _line: None)
