"""The picture that a level camera without distortion would take: one column for each bearing.

All points above one another have one bearing, so an object on the floor is upright in one column,
and the first row of the column that is not floor is its foot. A row is an angle below the horizon,
so it is one range on the floor for all columns. Rows lie as dense as the picture's own pixels do
along the middle column, near the robot half as dense. One lookup does it all: lens, roll, pitch,
and the part that is needed.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.model.sensors.camera_geometry import CameraGeometry

ABOVE_HORIZON_ROWS: Final = 32
"""Rows used above the horizon, where there can be no floor."""
_CELL_SHARE: Final = 0.375
"""Size of a coarse cell as a share of the smallest obstacle: wherever that begins, two cells fit
within it."""
_DENSE: Final = 4000
"""Number of depressions by which rows are spaced evenly in the picture, 0.03 degrees apart."""
_SMALL_STEP: Final = 0.006
"""Step in range, as a share of it, below which every other row is left out."""


class GroundStrip:
    """Looks up the floor, up to a little above the horizon, in pictures of one camera.

    Parameters
    ----------
    camera
        The calibrated camera.
    config
        Free patch and maximum range.

    Attributes
    ----------
    bearings_rad
        Of the columns in `base`, from the foot point of the camera, falling: left first,
        (columns,) [rad].
    column_rad
        From column to column [rad].
    depression_rad
        Of the rows: angle below the horizon, falling: nearest first, (rows,) [rad].
    ranges_m
        Of the rows on the floor from the foot point, (rows,) [m]; inf from the horizon on.
    seen
        Which samples are in the picture, (rows, columns).
    pixel_rows
        Rows of the strip in one pixel of the picture, (rows, columns).
    patch
        Which samples belong to the free patch, (rows, columns).
    first_rows
        The first row that is judged, of each column, (columns,); the number of rows where there is
        none.
    floor_m
        How far the picture shows the floor without a break, (columns,) [m].
    horizon_row
        The first row that is not on the floor.
    edges
        Rows at which the coarse rows begin and, last, end, (n + 1,): the least obstacle is more
        than two of them high.
    halves
        Columns to either side of a cell of about that width, (n,).

    Raises
    ------
    ValueError
        If the camera sees too little floor.
    """

    def __init__(self, camera: CameraGeometry, config: GroundCameraConfig) -> None:
        self.camera = camera
        self._config = config
        self.height_m = camera.mount.z_m
        axis = camera.R_base_camera[:, 2]
        self._heading_rad = math.atan2(axis[1], axis[0])
        self.depression_rad = self._rows()
        self.bearings_rad = self._columns()
        gaps = max(1, len(self.bearings_rad) - 1)
        self.column_rad = float(self.bearings_rad[0] - self.bearings_rad[-1]) / gaps
        with np.errstate(divide="ignore"):
            self.ranges_m = np.where(
                self.depression_rad > 1e-9, self.height_m / np.tan(self.depression_rad), np.inf
            )
        self.horizon_row = int(np.sum(self.depression_rad > 1e-9))
        self._look_up(config)
        self.edges, self.halves = self._coarse(config)

    def look(self, image_bgr: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the strip of a picture, (rows, 2 columns, 3): two samples wide for each column.

        Parameters
        ----------
        image_bgr
            Picture of the camera's size, (height, width, 3).

        Raises
        ------
        ValueError
            If the picture is of another size or kind.
        """
        lens = self.camera.intrinsics
        wanted = (lens.height_px, lens.width_px, 3)
        if image_bgr.shape != wanted or image_bgr.dtype != np.uint8:
            raise ValueError(
                f"the picture must be {wanted} of uint8, as the calibration says, found "
                f"{image_bgr.shape} of {image_bgr.dtype}"
            )
        strip = cv2.remap(image_bgr, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(strip, np.uint8)

    def patch_outline_base(self) -> NDArray[np.float64]:
        """Return the corners of the free patch on the floor in `base`, (4, 2) [m]."""
        near = self._nearest_m() + self._config.patch_near_m
        far = near + self._config.patch_depth_m
        halves = self._config.patch_near_width_m / 2, self._config.patch_far_width_m / 2
        c, s = math.cos(self._heading_rad), math.sin(self._heading_rad)
        corners = np.array(
            [(near, halves[0]), (far, halves[1]), (far, -halves[1]), (near, -halves[0])]
        )
        turned = corners @ np.array([[c, s], [-s, c]])
        outline: NDArray[np.float64] = turned + self.camera.t_base_camera[:2]
        return outline

    def ranges_at(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ranges of places between rows, (n,) [m]; inf at the horizon."""
        depression = np.interp(rows, np.arange(len(self.depression_rad)), self.depression_rad)
        with np.errstate(divide="ignore"):
            return np.where(depression > 1e-9, self.height_m / np.tan(depression), np.inf)

    def _project(
        self, depression: NDArray[np.float64], bearing: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the pixels of directions, (n, 2) [px]; nan for what the lens cannot show."""
        across = np.cos(depression)
        directions = np.stack(
            [across * np.cos(bearing), across * np.sin(bearing), -np.sin(depression)], axis=1
        )
        return self.camera.project(self.camera.t_base_camera + directions)

    def _rows(self) -> NDArray[np.float64]:
        """Return depressions that are one pixel apart where the camera looks."""
        fine = np.radians(np.linspace(89.0, -30.0, _DENSE))
        pixels = self._project(fine, np.full(_DENSE, self._heading_rad))
        # A row is kept if any bearing shows it; the middle column alone tells how dense they lie.
        seen = self._seen_depressions(fine)
        if not np.any(seen & (fine > 1e-3)):
            raise self._no_floor()
        steps = np.linalg.norm(np.diff(pixels, axis=0), axis=1)
        path = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
        used = np.flatnonzero(seen & np.isfinite(pixels[:, 0]))
        horizon = float(np.interp(0.0, -fine, path))
        last = min(path[used[-1]], horizon + ABOVE_HORIZON_ROWS)
        wanted = np.arange(path[used[0]], last, 1.0)
        down = np.interp(wanted, path, fine)
        ranges = self.height_m / np.tan(np.maximum(down, 1e-6))
        # Every other row will do where a pixel is a small share of the range.
        coarse = np.append(np.diff(ranges) < _SMALL_STEP * ranges[:-1], False) & (down > 1e-6)
        wanted = wanted[~coarse | (np.arange(len(wanted)) % 2 == 0)]
        rows: NDArray[np.float64] = np.interp(wanted, path, fine)
        return rows

    def _no_floor(self) -> ValueError:
        """Return the error for a camera that does not see the floor."""
        mount = self.camera.mount
        return ValueError(
            f"the camera sees no floor ahead: height {mount.z_m} m, pitch "
            f"{mount.pitch_deg} deg down"
        )

    def _seen_depressions(self, fine: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return for depressions whether the picture shows them at any bearing."""
        seen = np.zeros(len(fine), np.bool_)
        for turn in np.radians(np.linspace(-60.0, 60.0, 25)):
            bearing = np.full(len(fine), self._heading_rad + turn)
            seen |= self.camera.inside(self._project(fine, bearing))
        return seen

    def _columns(self) -> NDArray[np.float64]:
        """Return bearings, evenly over the visible floor, two pixels apart at most."""
        turns = np.linspace(math.pi, -math.pi, 1441)[:-1]
        rows = self.depression_rad[self.depression_rad > 1e-3][
            :: max(1, len(self.depression_rad) // 60)
        ]
        grid_d, grid_b = np.meshgrid(rows, self._heading_rad + turns, indexing="ij")
        pixels = self._project(grid_d.ravel(), grid_b.ravel())
        seen = self.camera.inside(pixels).reshape(grid_d.shape).any(axis=0)
        widest = np.flatnonzero(seen)
        if widest.size == 0:
            raise self._no_floor()
        count = max(1, self.camera.intrinsics.width_px // 2)
        edges = np.linspace(turns[widest[0]], turns[widest[-1]], count + 1)
        return self._heading_rad + (edges[:-1] + edges[1:]) / 2

    def _look_up(self, config: GroundCameraConfig) -> None:
        """Make the lookup of the pixels, and the meaning of each sample."""
        rows, columns = len(self.depression_rad), len(self.bearings_rad)
        quarter = self.column_rad / 4
        twice = np.stack([self.bearings_rad + quarter, self.bearings_rad - quarter], axis=1).ravel()
        d, b = np.meshgrid(self.depression_rad, twice, indexing="ij")
        pixels = self._project(d.ravel(), b.ravel())
        inside = self.camera.inside(pixels).reshape(rows, columns, 2)
        self.seen = np.all(inside, axis=2)
        pixels[np.isnan(pixels)] = -1.0
        u, v = np.moveaxis(pixels.reshape(rows, 2 * columns, 2), 2, 0).astype(np.float32)
        self._maps = cv2.convertMaps(u, v, cv2.CV_16SC2)
        along = np.hypot(np.gradient(u[:, ::2], axis=0), np.gradient(v[:, ::2], axis=0))
        self.pixel_rows = 1.0 / np.maximum(along, 0.05)
        self.patch = self._patch(config)
        # Rows before the patch may show the robot itself.
        ahead = self.ranges_m[:, None] * np.cos(self.bearings_rad - self._heading_rad)
        judged = self.seen & (ahead >= self._nearest_m() + config.patch_near_m)
        judged[self.horizon_row :] = False
        first = np.argmax(judged, axis=0)
        self.first_rows = np.where(judged.any(axis=0), first, rows)
        after = ~self.seen & (np.arange(rows)[:, None] >= first)
        ends = np.where(after.any(axis=0), np.argmax(after, axis=0), rows) - 1
        self.floor_m = np.where(judged.any(axis=0), self.ranges_m[ends], 0.0)

    def _coarse(self, config: GroundCameraConfig) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the coarse rows' edges, and half their columns' windows."""
        edges = [0]
        halves = []
        while edges[-1] < len(self.depression_rad):
            row = edges[-1]
            range_m = min(float(self.ranges_m[row]), config.max_range_m)
            top = math.atan2(self.height_m - config.least_height_m, range_m)
            step = 4
            if row < self.horizon_row:
                step = int(_CELL_SHARE * np.sum(self.depression_rad[row:] > top))
            edges.append(min(row + max(2, step), len(self.depression_rad)))
            halves.append(
                max(1, int(_CELL_SHARE / 2 * config.least_width_m / range_m / self.column_rad))
            )
        return np.array(edges), np.array(halves)

    def _nearest_m(self) -> float:
        """Return how far ahead of the foot point the nearest floor is seen [m]."""
        middle = np.argmin(np.abs(self.bearings_rad - self._heading_rad))
        seen = np.flatnonzero(self.seen[: self.horizon_row, middle])
        if seen.size == 0:
            raise self._no_floor()
        return float(self.ranges_m[seen[0]])

    def _patch(self, config: GroundCameraConfig) -> NDArray[np.bool_]:
        """Return which samples belong to the trapezoid of the free patch."""
        turned = self.bearings_rad - self._heading_rad
        with np.errstate(invalid="ignore"):
            ahead = self.ranges_m[:, None] * np.cos(turned)
            aside = self.ranges_m[:, None] * np.sin(turned)
            depth = (ahead - self._nearest_m() - config.patch_near_m) / config.patch_depth_m
            half = (
                config.patch_near_width_m
                + depth * (config.patch_far_width_m - config.patch_near_width_m)
            ) / 2
            patch: NDArray[np.bool_] = (
                self.seen & (depth >= 0.0) & (depth <= 1.0) & (np.abs(aside) <= half)
            )
        patch[self.horizon_row :] = False
        if np.sum(patch) < 200:
            raise ValueError(
                f"the free patch has only {np.sum(patch)} samples of the picture, at least 200 "
                f"are needed: it begins {self._nearest_m() + config.patch_near_m:.2f} m ahead"
            )
        return patch
