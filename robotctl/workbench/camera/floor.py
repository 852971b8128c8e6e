"""`robotctl camera floor`: the floor of a picture in metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration.floor import (
    FloorWindow,
    draw_grid,
    draw_points,
    view_from_above,
)
from robotctl.model.sensors.camera_geometry import CameraGeometry


def floor_picture(
    picture: NDArray[np.uint8],
    camera: CameraGeometry,
    view: FloorWindow,
    pixels: NDArray[np.float64] | None,
) -> NDArray[np.uint8]:
    """Return the view from above with its grid and, if there are any, the points of pixels."""
    above = view_from_above(picture, camera, view)
    draw_grid(above, view)
    if pixels is not None:
        draw_points(above, view, camera.ground(pixels))
    return above


def floor_table(
    camera: CameraGeometry, pixels: NDArray[np.float64], sigma_px: float
) -> NDArray[np.float64]:
    """Return u, v, x, y and the standard deviations of x and y, (n, 6) [px, m]; nan: no floor."""
    ground, P = camera.ground_covariance(pixels, sigma_px)
    sigma_m = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    return np.column_stack([pixels, ground, sigma_m])
