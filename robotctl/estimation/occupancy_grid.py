"""An occupancy grid from range scans and sonars at known poses (notes, section 5.1, with errata).

Each cell holds the log odds of being occupied, ln P(O) / P(E); 0 is P = 0.5, unknown. A measurement
z = d adds a constant: negative to the cells that the beam passes closer than d, positive to those
around d, nothing beyond d. This takes the cells as independent and the poses as exact.

Within one scan a cell changes at most once, by the strongest rule that it meets: a cell with an
echo is not lowered by the beams beside it, however many pass. Without that, the many beams of one
scan near the sensor would count as independent looks, which they are not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.occupancy_config import OccupancyGridConfig
from robotctl.estimation.occupancy_kernels import add_cone, add_scans, measure_scans
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.model.range_scan import RangeScan
from robotctl.model.se2 import SE2
from robotctl.model.sonar import SonarMount

CHUNK = 64
"""The array's sides are multiples of this [cells]."""
MAX_CELLS = 200_000_000
"""More are refused: a pose far off would ask for all memory."""
MAX_AWAY = 1e9
"""Poses farther from the world's origin are refused [cells]."""
BATCH = 512
"""Scans that are prepared together: the more, the less Python each costs."""


@dataclass(frozen=True, slots=True)
class GridFigures:
    """How much of a grid is known.

    Parameters
    ----------
    seen_m2
        Area of all cells with evidence [m^2].
    coverage
        Their share of the rectangle around them, 0 to 1.
    entropy_bits
        Sum over that rectangle of -p log2 p - (1 - p) log2 (1 - p) [bit]; 1 for an unknown cell.
    mean_entropy_bits
        The same for an average cell with evidence [bit].
    """

    seen_m2: float
    coverage: float
    entropy_bits: float
    mean_entropy_bits: float


class OccupancyGrid:
    """Log odds of square cells aligned with `world`; grows where a scan reaches beyond it.

    Parameters
    ----------
    config
        Evidence and resolution.
    """

    def __init__(self, config: OccupancyGridConfig | None = None) -> None:
        self.config = config or OccupancyGridConfig()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._cells = np.zeros((0, 0), np.int8)
        self._corner = np.zeros(2, np.int64)  # row and column of the array's first cell in world

    def update_scan(self, pose: SE2, scan: RangeScan) -> None:
        """Add one lidar scan taken at a pose of `base` in `world`.

        Raises
        ------
        ValueError
            If the pose is not finite or the grid would become too large; the grid stays as it was.
        """
        self.update_scans(np.array([[pose.x_m, pose.y_m, pose.theta_rad]]), [scan])

    def update_scans(self, poses: NDArray[np.float64], scans: Sequence[RangeScan]) -> None:
        """Add many scans, each taken at its pose (n, 3) of `base` in `world` [m, m, rad].

        Raises
        ------
        ValueError
            If the numbers differ, a pose is not finite or the grid would become too large; of more
            than `BATCH` scans the first may be in the grid then.
        """
        if poses.shape != (len(scans), 3) or not np.all(np.isfinite(poses)):
            raise ValueError(f"poses must be ({len(scans)}, 3) and finite, found {poses.shape}")
        for begin in range(0, len(scans), BATCH):
            self._add(poses[begin : begin + BATCH], scans[begin : begin + BATCH])

    def _add(self, poses: NDArray[np.float64], scans: Sequence[RangeScan]) -> None:
        """Add scans that are prepared together."""
        config = self.config
        ends = np.cumsum([len(scan.ranges_m) for scan in scans])
        starts, pattern = _pattern(scans)
        mounts = np.array([(scan.x_m, scan.y_m) for scan in scans])
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = (poses[:, 0] + c * mounts[:, 0] - s * mounts[:, 1]) / config.resolution_m
        y = (poses[:, 1] + s * mounts[:, 0] + c * mounts[:, 1]) / config.resolution_m
        sensors = np.stack([x, y, c, s], axis=1)
        if not np.all(np.abs(sensors) < MAX_AWAY):
            raise ValueError(f"poses must lie less than {MAX_AWAY:g} cells away")
        beams, bounds = measure_scans(
            np.concatenate([scan.ranges_m for scan in scans]),
            np.array([scan.max_range_m for scan in scans]),
            starts,
            ends,
            pattern,
            sensors,
            config.resolution_m,
            config.range_limit_m,
            config.no_echo_m,
        )
        first, end = bounds.min(axis=0), bounds.max(axis=0)
        self._hold(first[:2], end[2:])
        add_scans(
            self._cells,
            self._corner,
            ends,
            sensors,
            beams,
            bounds,
            math.sin(math.radians(config.fan_deg)),
            config.steps(config.hit),
            config.steps(config.miss),
        )

    def update_sonar(self, pose: SE2, mount: SonarMount, range_m: float) -> None:
        """Add one sonar's range [m], heard at a pose of `base` in `world`.

        inf is no echo, after which the cone is free up to `sonar_no_echo_m`; nan says nothing.

        Raises
        ------
        ValueError
            If the range is negative, the pose not finite, or the grid would become too large.
        """
        config = self.config
        if math.isnan(range_m):
            return
        if not math.isfinite(pose.x_m + pose.y_m + pose.theta_rad):
            raise ValueError(f"the pose must be finite, found {pose}")
        sensor = pose @ SE2(mount.x_m, mount.y_m, mount.heading_rad)
        side_m = config.resolution_m
        if range_m < 0.0:
            raise ValueError(f"range_m must be >= 0, found {range_m}")
        if max(abs(sensor.x_m), abs(sensor.y_m)) >= MAX_AWAY * side_m:
            raise ValueError(f"the pose must lie less than {MAX_AWAY:g} cells away, found {pose}")
        echo = range_m < config.sonar_range_m
        free_m = config.sonar_no_echo_m if math.isinf(range_m) else config.sonar_range_m
        distance = (range_m if echo else free_m) / side_m
        band = max(config.sonar_band_m / side_m, math.sqrt(0.5))
        x, y = sensor.x_m / side_m, sensor.y_m / side_m
        middle, reach = np.array([y, x]), distance + band + 2.0
        self._hold(
            np.floor(middle - reach).astype(np.int64), np.ceil(middle + reach).astype(np.int64)
        )
        add_cone(
            self._cells,
            x - self._corner[1],
            y - self._corner[0],
            sensor.theta_rad,
            math.radians(0.5 * config.sonar_width_deg),
            distance,
            band if echo else 0.0,
            echo,
            config.steps(config.sonar_hit),
            config.steps(config.sonar_miss),
        )

    def _hold(self, first: NDArray[np.int64], end: NDArray[np.int64]) -> None:
        """Let the array hold the world's cells from a (row, column) to behind another.

        A side that must grow grows by half of what there is, so that the cost of copying stays in
        proportion to the area; whole chunks, and cells stay where they are in the world.

        Raises
        ------
        ValueError
            If the array would have more than `MAX_CELLS`.
        """
        shape = np.array(self._cells.shape)
        old_first = self._corner if self._cells.size else first
        old_end = old_first + shape
        if np.all(first >= old_first) and np.all(end <= old_end):
            return
        spare = shape // 2
        new_first = np.where(first < old_first, np.minimum(first, old_first - spare), old_first)
        new_end = np.where(end > old_end, np.maximum(end, old_end + spare), old_end)
        new_first, new_end = new_first // CHUNK * CHUNK, -(-new_end // CHUNK) * CHUNK
        rows, columns = (int(size) for size in new_end - new_first)
        if rows * columns > MAX_CELLS:
            raise ValueError(
                f"a grid of {rows} x {columns} cells of {self.config.resolution_m:g} m would be "
                f"needed, at most {MAX_CELLS} cells are allowed: is a pose or a range wrong?"
            )
        cells = np.zeros((rows, columns), np.int8)
        row, column = (int(size) for size in old_first - new_first)
        cells[row : row + shape[0], column : column + shape[1]] = self._cells
        self._cells, self._corner = cells, new_first

    def log_odds(self) -> NDArray[np.float64]:
        """Return the log odds of the cells of `to_map`, (rows, columns)."""
        return np.asarray(self._known()[0] * self.config.step, np.float64)

    def to_map(self, occupied_above: float = 0.65, free_below: float = 0.4) -> GridMap:
        """Return which cells are occupied, free or unknown, by the probability of being occupied.

        The map is the smallest rectangle around all evidence; without any, one unknown cell.

        Raises
        ------
        ValueError
            If not 0 <= free_below < occupied_above <= 1.
        """
        if not 0.0 <= free_below < occupied_above <= 1.0:
            raise ValueError(
                "free_below and occupied_above must be 0 <= free_below < occupied_above <= 1, "
                f"found {free_below} and {occupied_above}"
            )
        known, corner = self._known()
        probability = 1.0 / (1.0 + np.exp(-np.arange(-128, 128) * self.config.step))
        value = np.full(256, UNKNOWN, np.int8)
        value[probability > occupied_above] = OCCUPIED
        value[probability < free_below] = FREE
        value[128] = UNKNOWN  # no evidence
        side_m = self.config.resolution_m
        origin = SE2(float(corner[1]) * side_m, float(corner[0]) * side_m)
        return GridMap(value[known.astype(np.int16) + 128], side_m, origin)

    def figures(self) -> GridFigures:
        """Return how much is known; a cell counts as seen while its log odds are not 0."""
        known, _ = self._known()
        counts = np.bincount((known.astype(np.int16) + 128).ravel(), minlength=256)
        p = 1.0 / (1.0 + np.exp(-np.arange(-128, 128) * self.config.step))
        entropy = -p * np.log2(p) - (1.0 - p) * np.log2(1.0 - p)
        unseen = int(counts[128])
        seen = known.size - unseen
        total = float(counts @ entropy)
        return GridFigures(
            seen_m2=seen * self.config.resolution_m**2,
            coverage=seen / known.size,
            entropy_bits=total,
            mean_entropy_bits=(total - unseen) / seen if seen else 1.0,
        )

    def _known(self) -> tuple[NDArray[np.int8], NDArray[np.int64]]:
        """Return the smallest rectangle around all evidence, and its first row and column."""
        rows, columns = np.flatnonzero(self._cells.any(1)), np.flatnonzero(self._cells.any(0))
        if len(rows) == 0:
            return np.zeros((1, 1), np.int8), np.zeros(2, np.int64)
        box = self._cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return box, self._corner + np.array([rows[0], columns[0]])


def _pattern(scans: Sequence[RangeScan]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return where each scan's directions begin, (n,), in cos and sin of directions, (p, 2).

    Scans of one sensor often share one array of angles, which is then needed once.
    """
    arrays = {id(scan.angles_rad): scan.angles_rad for scan in scans}
    begins = np.cumsum([0, *(len(angles) for angles in arrays.values())])
    place = dict(zip(arrays, begins.tolist(), strict=False))
    starts = np.array([place[id(scan.angles_rad)] for scan in scans])
    angles = np.concatenate(list(arrays.values()))
    return starts, np.stack([np.cos(angles), np.sin(angles)], axis=1)
