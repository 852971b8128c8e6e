"""A calibration drawn into the picture: a grid on the floor, and points."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration.floor import GRID, GRID_M, label
from robotctl.model.sensors.camera_geometry import CameraGeometry

_RIGHT = (0, 190, 0)
_WRONG = (0, 0, 230)
"""Colours of points that agree and that do not, blue, green, red."""
_LIMIT_PX = 30_000.0
"""Greatest coordinate that is drawn [px]: OpenCV's are 16 bits with fractions."""
_PIECE_M = 0.05
"""Length of a straight piece of a line, which the lens bends [m]."""
_FAR_M, _SIDE_M = 3.0, 1.5


def draw_floor_grid(picture: NDArray[np.uint8], camera: CameraGeometry) -> None:
    """Draw lines of constant x and y of the floor, in `base`, with their metres."""
    step = GRID_M
    xs = step * np.arange(math.ceil((camera.mount.x_m - _FAR_M) / step), _FAR_M / step + 1e-9)
    ys = step * np.arange(-math.floor(_SIDE_M / step), _SIDE_M / step + 1e-9)
    along_x = np.arange(xs[0], xs[-1] + 1e-9, _PIECE_M)
    along_y = np.arange(ys[0], ys[-1] + 1e-9, _PIECE_M)
    for x_m in xs:
        line = np.column_stack([np.full(len(along_y), x_m), along_y])
        _draw_line(picture, camera, line)
        _label(picture, camera, (float(x_m), 0.0), f"x {x_m:g}")
    for y_m in ys:
        line = np.column_stack([along_x, np.full(len(along_x), y_m)])
        _draw_line(picture, camera, line)
        _label(picture, camera, (1.0, float(y_m)), f"y {y_m:g}")


def draw_correspondences(
    picture: NDArray[np.uint8],
    measured: NDArray[np.float64],
    predicted: NDArray[np.float64],
    agree: NDArray[np.bool_],
) -> None:
    """Draw measured pixels, (n, 2): green if they agree, else red with a line to the predicted.

    The line is left out where the predicted pixel, (n, 2), is nan.
    """
    for seen, told, right in zip(measured, predicted, agree, strict=True):
        at = _pixel(seen)
        cv2.circle(picture, at, 4, _RIGHT if right else _WRONG, 1, cv2.LINE_AA)
        if not right and np.all(np.abs(told) < _LIMIT_PX):
            cv2.line(picture, at, _pixel(told), _WRONG, 1, cv2.LINE_AA)


def _draw_line(
    picture: NDArray[np.uint8], camera: CameraGeometry, ground: NDArray[np.float64]
) -> None:
    """Draw a line of floor points, (n, 2), piece by piece, where it is in sight."""
    pixels = camera.project_ground(ground)
    seen = np.all(np.abs(pixels) < _LIMIT_PX, axis=1)
    for i in np.flatnonzero(seen[1:] & seen[:-1]):
        cv2.line(picture, _pixel(pixels[i]), _pixel(pixels[i + 1]), GRID, 1, cv2.LINE_AA)


def _label(
    picture: NDArray[np.uint8], camera: CameraGeometry, ground: tuple[float, float], text: str
) -> None:
    """Write at a point of the floor, if it is in the picture."""
    pixel = camera.project_ground(np.array([ground]))
    if camera.inside(pixel)[0]:
        label(picture, text, _pixel(pixel[0]))


def _pixel(pixel: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))
