"""An occupancy grid from range scans and sonars at known poses (Elfes 1989).

Each cell holds the log odds of being occupied, ln P(O) / P(E); 0 is P = 0.5, unknown. A measurement
z = d adds a constant: negative to the cells that the beam passes closer than d, positive to those
around d, nothing beyond d. Cells are assumed independent, poses exact.

Within one scan a cell changes at most once, by the strongest rule that it meets: a cell with an
echo is not lowered by the beams beside it, however many pass. Without that, the many beams of one
scan near the sensor would count as independent looks, which they are not.

A building fits into one array, the window. Over a campus, of which little is known, the window
follows the robot, and the cells it leaves are kept in tiles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.grid.cell_tiles import SIDE, CellTiles
from robotctl.estimation.grid.config import OccupancyGridConfig
from robotctl.estimation.grid.kernels import add_cone, add_scans, measure_scans
from robotctl.estimation.grid.map_rows import MapRows, inner
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount

MAX_CELLS = 200_000_000
"""A larger map is refused: one wrong pose far away would take all memory."""
WINDOW_CELLS = 4096 * 4096
"""A larger area is kept in tiles."""
_NEW_WINDOW = 2048
"""Minimum side of a window that has moved [cells]."""
MAX_AWAY = 1e9
"""Poses further from the origin of `world` are refused [cells]."""
MARGIN_M = 0.5
"""Approximate margin of unknown cells around a cropped map [m]."""
STRAYS = 0.0002
"""Share of the known cells that a map may lose at each side: rays leave by windows and doors."""
_STRIP = 256
"""Rows processed together."""
BATCH = 512
"""Scans prepared together: larger batches spread the cost of Python over more scans."""


@dataclass(frozen=True, slots=True)
class GridFigures:
    """Statistics of what is known of a grid.

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
        self._cells = np.zeros((0, 0), np.int8)  # the window
        self._corner = np.zeros(2, np.int64)  # row and column of its first cell in world
        self._tiles = CellTiles()
        self._reach: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

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
        if any(scan.others for scan in scans):
            poses = np.repeat(poses, [len(scan.parts) for scan in scans], axis=0)
            scans = [part for scan in scans for part in scan.parts]
        for begin in range(0, len(scans), BATCH):
            self._add(poses[begin : begin + BATCH], scans[begin : begin + BATCH])

    def _add(self, poses: NDArray[np.float64], scans: Sequence[RangeScan]) -> None:
        """Add one batch of scans."""
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
        first, end = bounds.min(axis=0)[:2], bounds.max(axis=0)[2:]
        self._check_reach(first, end)
        # Scans of distant places do not fit into one window: add them in two halves.
        if len(scans) > 1 and np.prod(end - first) > WINDOW_CELLS:
            half = len(scans) // 2
            self._add(poses[:half], scans[:half])
            self._add(poses[half:], scans[half:])
            return
        self._hold(first, end)
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
        """Add one sonar's range [m], measured at a pose of `base` in `world`.

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
        # A thinner arc could pass between the centres of cells.
        band = max(config.sonar_band_m / side_m, math.sqrt(0.5))
        x, y = sensor.x_m / side_m, sensor.y_m / side_m
        middle, reach = np.array([y, x]), distance + band + 2.0
        first = np.floor(middle - reach).astype(np.int64)
        end = np.ceil(middle + reach).astype(np.int64)
        self._check_reach(first, end)
        self._hold(first, end)
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

    def _check_reach(self, first: NDArray[np.int64], end: NDArray[np.int64]) -> None:
        """Extend the reached rectangle by cells from `first` to before `end`, each (row, column).

        Raises
        ------
        ValueError
            If a map of everything reached so far would have more than `MAX_CELLS`.
        """
        if self._reach is not None:
            first, end = np.minimum(first, self._reach[0]), np.maximum(end, self._reach[1])
        rows, columns = (int(size) for size in end - first)
        if rows * columns > MAX_CELLS:
            raise ValueError(
                f"a grid of {rows} x {columns} cells of {self.config.resolution_m:g} m would be "
                f"needed, at most {MAX_CELLS} cells are allowed: is a pose or a range wrong?"
            )
        self._reach = first, end

    def _hold(self, first: NDArray[np.int64], end: NDArray[np.int64]) -> None:
        """Make the window hold the cells from `first` to before `end`, each (row, column) in world.

        A side that must grow grows by half its length, so that the cost of copying stays
        proportional to the area. A window that would become too large moves instead. Cells keep
        their positions in world.
        """
        shape = np.array(self._cells.shape)
        old_first = self._corner if self._cells.size else first
        old_end = old_first + shape
        if np.all(first >= old_first) and np.all(end <= old_end):
            return
        spare = shape // 2
        new_first = np.where(first < old_first, np.minimum(first, old_first - spare), old_first)
        new_end = np.where(end > old_end, np.maximum(end, old_end + spare), old_end)
        goes = bool(np.prod(new_end - new_first) > WINDOW_CELLS) and self._cells.size > 0
        if goes:
            self._tiles.put(self._cells, self._corner)
            # Room on all sides, so that the window does not move again at once.
            around = np.maximum(_NEW_WINDOW - (end - first), 0) // 2
            new_first, new_end = first - around, end + around
        # Whole tiles, so that what leaves the window can be put away as it is.
        new_first, new_end = new_first // SIDE * SIDE, -(-new_end // SIDE) * SIDE
        rows, columns = (int(size) for size in new_end - new_first)
        cells = np.zeros((rows, columns), np.int8)
        if len(self._tiles):
            self._tiles.fill(cells, new_first)
        if not goes:
            row, column = (int(size) for size in old_first - new_first)
            cells[row : row + shape[0], column : column + shape[1]] = self._cells
        self._cells, self._corner = cells, new_first

    def log_odds(self) -> NDArray[np.float64]:
        """Return the log odds of the cells of `to_map`, (rows, columns)."""
        first, end = self._known()
        odds = np.zeros(tuple(end - first), np.float64)
        for part, cells in self.parts(first, end):
            odds[part] = cells * self.config.step
        return odds

    def to_map(self, occupied_above: float = 0.65, free_below: float = 0.4) -> GridMap:
        """Return which cells are occupied, free or unknown, by the probability of being occupied.

        The map is the smallest rectangle around all evidence; without any, one unknown cell.

        Raises
        ------
        ValueError
            If not 0 <= free_below < occupied_above <= 1.
        """
        return self.map_rows(occupied_above, free_below).whole()

    def map_rows(
        self, occupied_above: float = 0.65, free_below: float = 0.4, strays: float | None = None
    ) -> MapRows:
        """Return the map row by row, each as the grid is when the row is read.

        Parameters
        ----------
        occupied_above, free_below
            See `to_map`.
        strays
            None: the rectangle of `to_map`. Otherwise each side is cropped while that cuts off no
            more than this share of the known cells, and gets a margin of `MARGIN_M`.

        Raises
        ------
        ValueError
            See `to_map`.
        """
        if not 0.0 <= free_below < occupied_above <= 1.0:
            raise ValueError(
                "free_below and occupied_above must be 0 <= free_below < occupied_above <= 1, "
                f"found {free_below} and {occupied_above}"
            )
        probability = 1.0 / (1.0 + np.exp(-np.arange(-128, 128) * self.config.step))
        value = np.full(256, UNKNOWN, np.int8)
        value[probability > occupied_above] = OCCUPIED
        value[probability < free_below] = FREE
        value[128] = UNKNOWN  # no evidence
        value = np.roll(value, 128)  # by the cell as a byte
        first, end = self._known()
        if strays is not None:
            first, end = self._cropped(first, end, value, strays)
        return MapRows(self.parts, first, end, value, self.config.resolution_m)

    def _cropped(
        self,
        first: NDArray[np.int64],
        end: NDArray[np.int64],
        value: NDArray[np.int8],
        strays: float,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return a rectangle without the strays at its sides; see `map_rows`."""
        counts = [np.zeros(size, np.int64) for size in (end - first).tolist()]
        for (rows, columns), cells in self.parts(first, end):
            known = value.take(cells.view(np.uint8)) != UNKNOWN
            counts[0][rows] += known.sum(axis=1)
            counts[1][columns] += known.sum(axis=0)
        if not counts[0].any():
            return first, end
        off = [inner(count, strays * float(count.sum())) for count in counts]
        margin = math.ceil(MARGIN_M / self.config.resolution_m)
        return (
            first + np.array([low for low, _ in off]) - margin,
            first + np.array([high for _, high in off]) + margin,
        )

    def figures(self) -> GridFigures:
        """Return how much is known; a cell counts as seen if its log odds are not 0."""
        first, end = self._known()
        counts = np.zeros(256, np.int64)
        for _, cells in self.parts(first, end):
            counts += np.bincount(cells.view(np.uint8).ravel(), minlength=256)
        counts = np.roll(counts, 128)
        size = int(np.prod(end - first))
        seen = int(counts.sum() - counts[128])
        counts[128] = size - seen
        p = 1.0 / (1.0 + np.exp(-np.arange(-128, 128) * self.config.step))
        entropy = -p * np.log2(p) - (1.0 - p) * np.log2(1.0 - p)
        total = float(counts @ entropy)
        return GridFigures(
            seen_m2=seen * self.config.resolution_m**2,
            coverage=seen / size,
            entropy_bits=total,
            mean_entropy_bits=(total - (size - seen)) / seen if seen else 1.0,
        )

    def _pieces(self) -> Iterator[tuple[int, int, NDArray[np.int8]]]:
        """Yield the pieces that hold all evidence: first row and column in world, and cells."""
        if len(self._tiles):
            self._tiles.put(self._cells, self._corner)
            yield from self._tiles
            return
        for row in range(0, self._cells.shape[0], _STRIP):
            yield (
                int(self._corner[0]) + row,
                int(self._corner[1]),
                self._cells[row : row + _STRIP],
            )

    def parts(
        self, first: NDArray[np.int64], end: NDArray[np.int64]
    ) -> Iterator[tuple[tuple[slice, slice], NDArray[np.int8]]]:
        """Yield the parts of a rectangle with evidence, and their cells [steps].

        The rectangle goes from `first` to before `end`, each (row, column) in world.
        """
        height, width = (int(size) for size in end - first)
        for row, column, cells in self._pieces():
            r, c = row - int(first[0]), column - int(first[1])
            top, left = max(r, 0), max(c, 0)
            bottom, right = min(r + cells.shape[0], height), min(c + cells.shape[1], width)
            if top < bottom and left < right:
                inside = cells[top - r : bottom - r, left - c : right - c]
                yield (slice(top, bottom), slice(left, right)), inside

    def _known(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the smallest rectangle around all evidence: its first cell, and the end.

        Without evidence it is one cell.
        """
        firsts, ends = [], []
        for row, column, cells in self._pieces():
            rows, columns = np.flatnonzero(cells.any(1)), np.flatnonzero(cells.any(0))
            if len(rows):
                firsts.append((row + rows[0], column + columns[0]))
                ends.append((row + rows[-1] + 1, column + columns[-1] + 1))
        if not firsts:
            return np.zeros(2, np.int64), np.ones(2, np.int64)
        return np.min(firsts, axis=0).astype(np.int64), np.max(ends, axis=0).astype(np.int64)


def _pattern(scans: Sequence[RangeScan]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return where each scan's directions begin, (n,), in cos and sin of directions, (p, 2).

    Scans of one sensor often share one array of angles, which is then stored once.
    """
    arrays = {id(scan.angles_rad): scan.angles_rad for scan in scans}
    begins = np.cumsum([0, *(len(angles) for angles in arrays.values())])
    place = dict(zip(arrays, begins.tolist(), strict=False))
    starts = np.array([place[id(scan.angles_rad)] for scan in scans])
    angles = np.concatenate(list(arrays.values()))
    return starts, np.stack([np.cos(angles), np.sin(angles)], axis=1)
