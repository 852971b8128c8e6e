"""Pictures of sheets on a floor, as a camera of known mount sees them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration.pattern import PX_PER_MM
from robotctl.model.sensors.camera_geometry import CameraGeometry

NEAR_M, FAR_M, HALF_WIDTH_M = 0.3, 2.3, 1.0
M_PER_PX = 0.0015
_FINER = 2


@dataclass(frozen=True)
class Sheet:
    """A printed sheet with its middle at x, y and its arrow towards the heading."""

    printed: NDArray[np.uint8]
    x_m: float
    y_m: float
    heading_deg: float = 0.0


def floor_of(sheets: Sequence[Sheet], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return the floor from above, x up and y left."""
    height = round((FAR_M - NEAR_M) / M_PER_PX)
    width = round(2.0 * HALF_WIDTH_M / M_PER_PX)
    rough = rng.normal(150.0, 12.0, (height // 4, width // 4)).astype(np.float32)
    floor = cv2.resize(rough, (width, height))
    for sheet in sheets:
        coarse = 1e-3 / PX_PER_MM / M_PER_PX
        small = cv2.resize(
            sheet.printed, None, fx=4 * coarse, fy=4 * coarse, interpolation=cv2.INTER_AREA
        )
        rows, columns = small.shape
        c, s = (f(math.radians(sheet.heading_deg)) for f in (math.cos, math.sin))
        corners = []
        for u, v in ((0, 0), (columns, 0), (0, rows)):
            up_m, left_m = (
                0.25 * M_PER_PX * (rows / 2 - v),
                0.25 * M_PER_PX * (columns / 2 - u),
            )
            x_m, y_m = sheet.x_m + c * up_m - s * left_m, sheet.y_m + s * up_m + c * left_m
            corners.append(((HALF_WIDTH_M - y_m) / M_PER_PX, (FAR_M - x_m) / M_PER_PX))
        affine = cv2.getAffineTransform(
            np.float32([[-0.5, -0.5], [columns - 0.5, -0.5], [-0.5, rows - 0.5]]),
            np.float32(corners) - np.float32(0.5),
        )
        there = cv2.warpAffine(np.full_like(small, 255), affine, (width, height))
        there = cv2.erode(there, np.ones((3, 3), np.uint8))
        seen = cv2.warpAffine(
            cv2.GaussianBlur(small, (0, 0), 1.6), affine, (width, height), flags=cv2.INTER_LINEAR
        )
        floor = np.where(there > 250, seen.astype(np.float32), floor)
    return floor


def picture_of(
    floor: NDArray[np.float32], camera: CameraGeometry, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return what the camera sees of the floor, with its lens and some noise."""
    lens = camera.intrinsics
    u, v = np.meshgrid(
        (np.arange(_FINER * lens.width_px) + 0.5) / _FINER - 0.5,
        (np.arange(_FINER * lens.height_px) + 0.5) / _FINER - 0.5,
    )
    ground = camera.ground(np.column_stack([u.ravel(), v.ravel()]))
    column = (HALF_WIDTH_M - ground[:, 1]) / M_PER_PX - 0.5
    row = (FAR_M - ground[:, 0]) / M_PER_PX - 0.5
    at = [
        np.nan_to_num(each, nan=-1e4).astype(np.float32).reshape(u.shape) for each in (column, row)
    ]
    fine = cv2.remap(floor, *at, cv2.INTER_LINEAR, borderValue=90.0)
    grey = cv2.resize(fine, (lens.width_px, lens.height_px), interpolation=cv2.INTER_AREA)
    grey = np.clip(grey + rng.normal(0.0, 2.0, grey.shape), 0.0, 255.0).astype(np.uint8)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR).astype(np.uint8)
