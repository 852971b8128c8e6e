"""Camera above a known floor: picture in, ranges and objects out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera import colour
from robotctl.estimation.camera.boundary import find_boundary, judge_lights
from robotctl.estimation.camera.config import FloorLookConfig, GroundCameraConfig
from robotctl.estimation.camera.obstacles import GroundObstacle, find_obstacles
from robotctl.estimation.camera.patch import PARTS, judge_patch
from robotctl.estimation.camera.scan import ColumnRanges, beam_scan, column_ranges
from robotctl.estimation.camera.strip import GroundStrip
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.model.sensors.range_scan import RangeScan


@dataclass(frozen=True, slots=True, eq=False)
class GroundView:
    """Result of one picture.

    Attributes
    ----------
    scan
        Ranges to the lowest boundary of the floor, from the camera's foot point in `base`.
    obstacles
        Free-standing objects; none if not trusted.
    why
        Why floor could not be distinguished from the rest; empty: it could. If not, the scan is all
        nan (nothing judged), or what the floor known from earlier pictures says, which errs to the
        near side.
    """

    scan: RangeScan
    obstacles: tuple[GroundObstacle, ...]
    why: str = ""

    @property
    def trusted(self) -> bool:
        """Whether floor could be distinguished from the rest."""
        return not self.why


class GroundCamera:
    """Learns the floor's colours and measures where the floor ends.

    Parameters
    ----------
    camera
        The calibrated camera.
    config
        Settings.

    Raises
    ------
    ValueError
        If the camera sees too little of the floor.
    """

    def __init__(self, camera: CameraGeometry, config: GroundCameraConfig) -> None:
        self.strip = GroundStrip(camera, config)
        self._config = config
        strip = self.strip
        self._log_prior = colour.log_obstacle_prior()
        middle = (strip.edges[:-1] + strip.edges[1:]) // 2
        self._seen = strip.seen[middle]
        self._parts = _parts(strip.patch[middle])
        n = len(middle)
        self._horizon = int(np.searchsorted(strip.edges, strip.horizon_row))
        self._above = self._seen.copy()
        self._above[: self._horizon + 1] = False
        self._first = np.minimum(np.searchsorted(strip.edges, strip.first_rows), n)
        after = ~self._seen & (np.arange(n)[:, None] >= self._first)
        self._beyond = np.where(after.any(axis=0), np.argmax(after, axis=0), n)
        reach = int(np.sum(strip.ranges_m <= config.max_range_m))
        self._last = min(int(np.searchsorted(strip.edges, reach)), self._horizon)
        reached = np.minimum(strip.ranges_m[strip.edges[:-1]], config.max_range_m)
        self._widths = config.obstacle_width_m / reached / strip.column_rad
        self.reset()

    def reset(self) -> None:
        """Forget the floor; it is learned again from the next picture."""
        self._floor: NDArray[np.float32] | None = None
        self._light: NDArray[np.int32] | None = None
        self._number = 0

    def step(self, image_bgr: NDArray[np.uint8], stamp_ns: int) -> GroundView:
        """Return the result of a picture, and learn from the picture.

        Parameters
        ----------
        image_bgr
            The picture, (height, width, 3).
        stamp_ns
            Its time [ns].

        Raises
        ------
        ValueError
            If the picture is not of the calibrated size.
        """
        pixels = self.strip.look(image_bgr)
        means, bins = colour.colour_bins(pixels, self.strip.edges, self.strip.halves)
        known = self._floor is not None
        floor, why = self._look_of_floor(bins, means)
        if floor is None:
            return self._blind(stamp_ns, why)
        above = colour.smoothed(colour.count(bins[self._above]))
        if colour.overlap(floor, above) > self._config.floor.above_alike_max:
            # A wall fills the picture, or the floor has its colour: nothing is learned from it.
            self._floor = floor if known else None
            return self._blind(
                stamp_ns,
                "what is above the horizon looks like the floor: they cannot be told apart",
            )
        self._floor = floor
        if known and not why and self._number % self._config.floor.learn_every == 0:
            self._adapt(bins, means)
        logs = colour.log_densities(self._floor, above, self._log_prior)
        evidence, walls = colour.evidence(logs, bins)
        judge_lights(
            evidence[: self._horizon], bins[: self._horizon], self._widths, self._config.boundary
        )
        boundary = find_boundary(
            evidence,
            walls,
            pixels,
            means,
            self.strip.edges,
            self._first,
            self._beyond,
            self._last,
            self._horizon,
            self._config.boundary,
        )
        ranges = column_ranges(self.strip, boundary, self._config)
        scan = beam_scan(self.strip, ranges, stamp_ns, self._config)
        obstacles = find_obstacles(self.strip, boundary, ranges, evidence, walls, self._config)
        return GroundView(scan, () if why else obstacles, why)

    def _look_of_floor(
        self, bins: NDArray[np.int32], means: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32] | None, str]:
        """Return the floor's density in a picture's exposure, and why that is not trusted.

        None if it was not known and the free patch does not tell it.
        """
        before, self._light = self._light, bins % colour.L_BINS
        self._number += 1
        if self._floor is None:
            verdict = judge_patch(bins, means, self._parts, self._config.floor)
            if verdict.why:
                return None, verdict.why
            return colour.smoothed(colour.count(verdict.bins)), ""
        patch = colour.smoothed(colour.count(bins[self._parts >= 0]))
        floor = self._floor
        if before is not None:
            floor = _exposed_alike(floor, patch, self._light - before, self._config.floor)
        if colour.overlap(floor, patch) < self._config.floor.familiar_min:
            return floor, "what is in front does not look like the floor seen so far"
        return floor, ""

    def _adapt(self, bins: NDArray[np.int32], means: NDArray[np.float32]) -> None:
        """Update the floor model with some of the free patch."""
        verdict = judge_patch(bins, means, self._parts, self._config.floor)
        if not verdict.why and self._floor is not None:
            new = colour.smoothed(colour.count(verdict.bins))
            a = np.float32(self._config.adaption)
            self._floor = (1 - a) * self._floor + a * new

    def _blind(self, stamp_ns: int, why: str) -> GroundView:
        """Return a view without a verdict."""
        nothing = np.full(len(self.strip.bearings_rad), np.nan)
        scan = beam_scan(
            self.strip, ColumnRanges(nothing, nothing, nothing, nothing), stamp_ns, self._config
        )
        return GroundView(scan, (), why)


def _parts(patch: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Return the part of the patch to which each coarse cell belongs; -1: none."""
    parts = np.full(patch.shape, -1, np.int8)
    rows = np.flatnonzero(patch.any(axis=1))
    for i in rows:
        columns = np.flatnonzero(patch[i])
        depth = (i - rows[0]) * PARTS // len(rows)
        across = np.arange(len(columns)) * PARTS // len(columns)
        parts[i, columns] = depth * PARTS + across
    return parts


def _exposed_alike(
    floor: NDArray[np.float32],
    patch: NDArray[np.float32],
    change: NDArray[np.int32],
    config: FloorLookConfig,
) -> NDArray[np.float32]:
    """Return the known floor under the exposure of a new picture.

    The floor is taken as brighter only by as much as the whole picture became: an obstacle of the
    floor's colour changes the patch alone.
    """
    shift = round(colour.brightness(patch) - colour.brightness(floor))
    whole = float(np.median(change))
    if abs(shift) < 2 or abs(shift) > config.exposure_max_bins:
        return floor
    if abs(shift - whole) > config.exposure_agrees_bins:
        return floor
    return colour.shifted(floor, shift)
