"""Printed square markers on upright things, such as docks: drawn over a finished picture."""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np

from firmware_sim.world.shapes import Marker

_PX_PER_CELL: Final = 16
_BLACK: Final = 25.0
_WHITE: Final = 225.0
_IN_FRONT_M: Final = 0.03
"""Maximum distance of a marker before its surface [m]."""


class MarkerPainter:
    """Paints the markers of a world.

    Each pixel takes the mean of the paper over about its own width; noise comes on top.

    Parameters
    ----------
    markers
        Markers of the world.
    ahead, left, slope
        Rays of the pixels, (height, width), as in `PixelRays`.
    turn_rad
        Angle between neighbouring pixels [rad].
    height_m
        Height of the camera [m].
    """

    def __init__(
        self,
        markers: tuple[Marker, ...],
        ahead: np.ndarray,
        left: np.ndarray,
        slope: np.ndarray,
        turn_rad: float,
        height_m: float,
    ) -> None:
        self._markers = [(each, _paper(each)) for each in markers]
        self._ahead, self._left, self._slope = ahead, left, slope
        self._turn_rad = turn_rad
        self._height_m = height_m

    def paint(
        self,
        picture: np.ndarray,
        distances: np.ndarray,
        pose: tuple[float, float, float],
        gain: np.ndarray,
        rng: np.random.Generator,
    ) -> None:
        """Paint all markers that are in view.

        Parameters
        ----------
        picture, distances
            As in `View`; the picture is changed.
        pose
            Place below the camera x, y [m], and its heading [rad].
        gain
            Share of the light that reaches each pixel.
        rng
            Generator of the noise.
        """
        if not self._markers:
            return
        x, y, heading = pose
        c, s = math.cos(heading), math.sin(heading)
        east, north = c * self._ahead - s * self._left, s * self._ahead + c * self._left
        for marker, paper in self._markers:
            facing = math.radians(marker.heading_deg)
            nx, ny = math.cos(facing), math.sin(facing)
            towards = east * nx + north * ny
            off_m = (marker.at[0] - x) * nx + (marker.at[1] - y) * ny
            if off_m >= 0.0:
                continue  # it is seen from behind
            with np.errstate(divide="ignore", invalid="ignore"):
                far_m = np.where(towards < 0.0, off_m / towards, np.inf)
                right_m = (y + far_m * north - marker.at[1]) * nx
                right_m -= (x + far_m * east - marker.at[0]) * ny
                up_m = self._height_m + far_m * self._slope - marker.z_m
            half_m = 0.5 * marker.side_m * paper.shape[0] / (paper.shape[0] - 2 * _PX_PER_CELL)
            seen = (np.abs(right_m) < half_m) & (np.abs(up_m) < half_m)
            seen &= far_m < distances + _IN_FRONT_M
            if not seen.any():
                continue
            scale = paper.shape[0] / (2.0 * half_m)
            columns, rows = (right_m[seen] + half_m) * scale, (half_m - up_m[seen]) * scale
            blur_px = max(1.0, float(np.median(far_m[seen])) * self._turn_rad * scale)
            smooth = cv2.GaussianBlur(paper, (0, 0), 0.5 * blur_px)
            values = smooth[rows.astype(int), columns.astype(int)]
            lit = values * gain[seen] + 2.0 * rng.standard_normal(len(values))
            picture[seen] = np.clip(lit, 0.0, 255.0).astype(np.uint8)[:, None]


def _paper(marker: Marker) -> np.ndarray:
    """Return a marker with a white border of one of its cells, float32."""
    family = getattr(cv2.aruco, f"DICT_{marker.family.upper()}")
    dictionary = cv2.aruco.getPredefinedDictionary(family)
    cells = dictionary.markerSize + 2
    bits = cv2.aruco.generateImageMarker(dictionary, marker.number, cells, borderBits=1) > 0
    bits = np.pad(bits, 1, constant_values=True)
    values = np.where(bits, _WHITE, _BLACK).astype(np.float32)
    paper: np.ndarray = np.kron(values, np.ones((_PX_PER_CELL, _PX_PER_CELL), np.float32))
    return paper
