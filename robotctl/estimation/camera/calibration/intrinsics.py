"""The lens from pictures of a chessboard (Zhang 2000), through OpenCV.

Intervals come from leaving out one picture at a time (jackknife): the corners of one picture err
together, by a sheet that is not flat or by blur, and intervals from the residuals alone are too
narrow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student  # type: ignore[import-untyped]

from robotctl.estimation.camera.calibration.pattern import Board
from robotctl.model.sensors.camera import CameraIntrinsics

KEYS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
LEAST_PICTURES = 4
"""Minimum number of pictures of the board."""
_FIELDS = 4
"""Parts of the picture along each side that should be covered."""
_OUTLYING = 3.0
"""Multiple of the median residual from which on a picture is left out."""
_FOCAL_SIGMA = 0.05
"""Relative standard deviation of the focal length from which on it is not determined."""
_FIRST = 4
"""Pictures of which all combinations of turns are tried; each further one is added to the best."""
_TURNED = 0.5
"""Share of its squared residuals by which a picture has to fit better turned to be called so."""


class TurnedPicturesError(ValueError):
    """Some pictures are turned by half a turn against the others, so no lens took all of them.

    Parameters
    ----------
    numbers
        Of the pictures, counted from 0: the fewer of the two kinds.
    """

    def __init__(self, numbers: Sequence[int]) -> None:
        super().__init__(f"pictures {', '.join(map(str, numbers))} are turned by half a turn")
        self.numbers = tuple(numbers)


@dataclass(frozen=True, slots=True, eq=False)
class LensFit:
    """A calibrated lens.

    Parameters
    ----------
    intrinsics
        The lens.
    half_width
        Half of the 95 % interval of each of `KEYS`, (9,).
    rms_px
        Root mean square of the residuals of each picture, (n,) [px]; nan for those left out.
    covered
        In which fields of the picture corners were seen, (4, 4), from the upper left.
    """

    intrinsics: CameraIntrinsics
    half_width: NDArray[np.float64]
    rms_px: NDArray[np.float64]
    covered: NDArray[np.bool_]

    @property
    def values(self) -> NDArray[np.float64]:
        """The values of `KEYS`, (9,)."""
        lens = self.intrinsics
        return np.array([lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion])


def calibrate_lens(
    corners: Sequence[NDArray[np.float64]], board: Board, width_px: int, height_px: int
) -> LensFit:
    """Calibrate a lens.

    Pictures whose residuals are over three times those of the middle one are left out.

    Parameters
    ----------
    corners
        The corners that `find_corners` found, one (n, 2) for each picture [px].
    board
        Whose they are.
    width_px, height_px
        Size of the pictures [px].

    Raises
    ------
    TurnedPicturesError
        If some pictures are turned by half a turn against the others, as files that were turned.
    ValueError
        With fewer than four pictures, also of those that fit, if no lens fits them, or if they do
        not tell the focal length, as those of a board that is never tilted.
    """
    _check_count(len(corners), "with the board")
    size = (width_px, height_px)
    rms_px = np.array(_calibrated(corners, board, size)[1])
    kept = np.flatnonzero(rms_px <= _OUTLYING * np.median(rms_px)).tolist()
    _check_count(len(kept), f"of {len(corners)} with the board fit each other")
    chosen = [corners[i] for i in kept]
    if turned := _turned(chosen, board, size):
        raise TurnedPicturesError([kept[i] for i in turned])
    values, of_each = _calibrated(chosen, board, size)
    all_px = np.full(len(corners), np.nan)
    all_px[kept] = of_each
    n = len(chosen)
    others = np.array(
        [_calibrated([*chosen[:i], *chosen[i + 1 :]], board, size)[0] for i in range(n)]
    )
    sigma = np.sqrt((n - 1) / n * np.sum((others - others.mean(axis=0)) ** 2, axis=0))
    if not sigma[0] < _FOCAL_SIGMA * values[0]:
        raise ValueError(
            f"these pictures do not determine the focal length ({values[0]:.0f} px, standard "
            "deviation "
            f"{sigma[0]:.0f}): tilt the board by 30 degrees and more in all directions"
        )
    fx, fy, cx, cy, *distortion = (float(value) for value in values)
    lens = CameraIntrinsics(width_px, height_px, fx, fy, cx, cy, tuple(distortion))
    half_width = sigma * float(student.ppf(0.975, n - 1))
    return LensFit(lens, half_width, all_px, _covered(chosen, size))


def _turned(
    corners: Sequence[NDArray[np.float64]], board: Board, size: tuple[int, int]
) -> list[int]:
    """Return which pictures are turned by half a turn against most of the others.

    A lens whose axis is off the middle of the picture fits only one kind. Turns of the first few
    pictures are tried in all combinations, those of the others one by one, as they come.
    """
    far = np.array(size) - 1.0

    def misfit(turns: Sequence[bool]) -> float:
        seen = [far - each if turn else each for each, turn in zip(corners, turns, strict=False)]
        return float(np.sum(np.square(_calibrated(seen, board, size)[1])))

    first = product([False], *[(False, True)] * (min(_FIRST, len(corners)) - 1))
    best = min(first, key=misfit)
    while len(best) < len(corners):
        best = min(((*best, turn) for turn in (False, True)), key=misfit)
    least = misfit(best)
    fewer = 2 * sum(best) <= len(best)
    return [
        number
        for number, turn in enumerate(best)
        if turn is fewer
        and misfit([turned != (k == number) for k, turned in enumerate(best)]) - least
        > _TURNED * least / len(best)
    ]


def _check_count(found: int, which: str) -> None:
    """Refuse too few pictures."""
    if found < LEAST_PICTURES:
        raise ValueError(
            f"{found} pictures {which}; {LEAST_PICTURES} are needed, 10 to 20 are good, with the "
            "board near, tilted in all directions, and in all parts of the picture"
        )


def _calibrated(
    corners: Sequence[NDArray[np.float64]], board: Board, size: tuple[int, int]
) -> tuple[NDArray[np.float64], list[float]]:
    """Return `KEYS`, (9,), and the residuals of each picture, root mean square [px].

    Raises
    ------
    ValueError
        If OpenCV finds none.
    """
    flat = np.column_stack([board.corners(), np.zeros(board.columns * board.rows)])
    flat[:, 1] *= -1.0
    places = [flat.astype(np.float32)] * len(corners)
    pixels = [each.astype(np.float32).reshape(-1, 1, 2) for each in corners]
    try:
        result = cv2.calibrateCameraExtended(places, pixels, size, np.eye(3), np.zeros(5))
    except cv2.error as error:
        raise ValueError(
            f"OpenCV finds no lens that shows the board so ({error.err}): is it flat, and are "
            "--board and all pictures right?"
        ) from error
    _, K, distortion, _, _, _, _, per_view = result
    values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *distortion.ravel()[:5]])
    # OpenCV's is the root of the mean over points of u^2 + v^2; here over u and v.
    return values, [float(each) / math.sqrt(2.0) for each in per_view.ravel()]


def _covered(corners: Sequence[NDArray[np.float64]], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return in which fields of the picture corners were seen, (4, 4)."""
    fields = np.floor(_FIELDS * np.vstack(list(corners)) / np.array(size)).astype(int)
    covered = np.zeros((_FIELDS, _FIELDS), dtype=np.bool_)
    u, v = np.clip(fields, 0, _FIELDS - 1).T
    covered[v, u] = True
    return covered
