"""The floor as seen from above: a picture put right, with a grid in metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.model.sensors.camera_geometry import CameraGeometry

GRID = (200, 160, 0)
"""Colour of a grid of the floor, blue, green, red."""
GRID_M = 0.5
"""Spacing of the grid's lines [m]."""
_MARK = (0, 0, 230)
"""Colour of a marked pixel, blue, green, red."""
_NOTHING = (60, 60, 60)
"""Colour of what the camera does not see, blue, green, red."""
_MAX_SIDE_PX = 8000
"""Maximum side of the view from above [px], 192 MB."""


@dataclass(frozen=True, slots=True)
class FloorWindow:
    """The part of the floor to show, and its scale; x is up and y is left.

    Parameters
    ----------
    near_m, far_m
        From and to which x in `base` [m].
    half_width_m
        To which y on either side [m].
    m_per_px
        Size of a pixel [m].

    Raises
    ------
    ValueError
        If the picture would have no pixels, or more than 8000 on a side.
    """

    near_m: float = 0.0
    far_m: float = 3.0
    half_width_m: float = 1.5
    m_per_px: float = 0.005

    def __post_init__(self) -> None:
        if not (math.isfinite(self.near_m) and self.near_m < self.far_m < math.inf):
            raise ValueError(f"near_m {self.near_m:g} must be less than far_m {self.far_m:g}")
        if not 0.0 < self.half_width_m < math.inf:
            raise ValueError(f"half_width_m must be > 0, not {self.half_width_m:g}")
        if not 0.0 < self.m_per_px < math.inf:
            raise ValueError(f"m_per_px must be > 0, not {self.m_per_px:g}")
        height, width = self.shape
        if not (1 <= height <= _MAX_SIDE_PX and 1 <= width <= _MAX_SIDE_PX):
            raise ValueError(
                f"{width} x {height} pixels of {self.m_per_px:g} m; allowed are 1 to "
                f"{_MAX_SIDE_PX} on a side"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the picture [px]."""
        return (
            round((self.far_m - self.near_m) / self.m_per_px),
            round(2.0 * self.half_width_m / self.m_per_px),
        )

    def points(self) -> NDArray[np.float64]:
        """Return the floor points (x, y) of all pixels, row by row, (n, 2) [m]."""
        height, width = self.shape
        x_m = self.far_m - (np.arange(height) + 0.5) * self.m_per_px
        y_m = self.half_width_m - (np.arange(width) + 0.5) * self.m_per_px
        return np.column_stack([np.repeat(x_m, width), np.tile(y_m, height)])

    def pixel_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the pixel (column, row) of a point of the floor."""
        return (
            round((self.half_width_m - y_m) / self.m_per_px - 0.5),
            round((self.far_m - x_m) / self.m_per_px - 0.5),
        )


def view_from_above(
    picture: NDArray[np.uint8], camera: CameraGeometry, view: FloorWindow
) -> NDArray[np.uint8]:
    """Return the floor seen from above; parts outside the camera's view are grey.

    Objects on the floor are smeared away from the camera: only the floor is rectified.

    Parameters
    ----------
    picture
        (height, width, 3), blue, green, red.
    camera
        Which took it.
    view
        The view.

    Returns
    -------
    ndarray
        (height, width, 3) of `view.shape`.
    """
    pixels = camera.project_ground(view.points())
    pixels[~camera.inside(pixels)] = -1e4
    maps = pixels.astype(np.float32).reshape(*view.shape, 2)
    above = cv2.remap(
        picture,
        maps[..., 0],
        maps[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=_NOTHING,
    )
    return above.astype(np.uint8, copy=False)


def draw_grid(above: NDArray[np.uint8], view: FloorWindow) -> None:
    """Draw lines of constant x and y with their metres into a view from above."""
    height, width = view.shape
    for k in range(math.ceil(view.near_m / GRID_M), math.floor(view.far_m / GRID_M) + 1):
        _, row = view.pixel_of(k * GRID_M, 0.0)
        cv2.line(above, (0, row), (width - 1, row), GRID, 1)
        label(above, f"x {k * GRID_M:g}", (4, row - 4))
    most = math.floor(view.half_width_m / GRID_M)
    for k in range(-most, most + 1):
        column, _ = view.pixel_of(0.0, k * GRID_M)
        cv2.line(above, (column, 0), (column, height - 1), GRID, 1)
        label(above, f"y {k * GRID_M:g}", (column + 4, height - 6))


def draw_points(above: NDArray[np.uint8], view: FloorWindow, ground: NDArray[np.float64]) -> None:
    """Draw a cross at each point (x, y) of the floor, (n, 2) [m]; nan is left out."""
    height, width = view.shape
    for x_m, y_m in ground[np.isfinite(ground).all(axis=1)]:
        column, row = view.pixel_of(x_m, y_m)
        if 0 <= column < width and 0 <= row < height:
            cv2.drawMarker(above, (column, row), _MARK, cv2.MARKER_CROSS, 11, 1)


def label(picture: NDArray[np.uint8], text: str, at: tuple[int, int]) -> None:
    """Write small letters that are seen on any ground."""
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(picture, text, at, font, 0.4, (255, 255, 255), 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, font, 0.4, GRID, 1, cv2.LINE_AA)
