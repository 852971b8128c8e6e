"""Exploring: the way until most of what can be reached is known, beside a greedy ideal.

The ideal is a point that turns and stops at no cost, on the true map in cells of 0.1 m. It sees all
free cells in sight within the lidar's range, exactly and at each tenth of a metre, and drives the
shortest way to the nearest cell from which it has not seen all, which it chooses again every half
metre. Without knowing the map, hardly anything can be much shorter all the time.

The robot finds itself by SLAM: on a map that its odometry bends, places are known where they are
not.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from benchmarks import machine
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.maps.world import find_world, load_walls
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap

SIDE_M = 0.1
SHARE = 0.98
REACH_M = 10.0
"""Farther away the live map takes no beam."""
BODY_M = 0.2
"""The ideal keeps this far off walls, as the robot has to."""
AGAIN_M = 0.5
STARTS = {
    "flat": SE2(1.0, 1.0, 0.0),
    "office": SE2(1.5, 7.5, 0.0),
}
SLAM = ('localisation.method="slam"',)
MISSION = (
    'name = "explore"\nworld = "{world}"\n'
    "start = {{ x_m = {start.x_m}, y_m = {start.y_m}, heading_deg = 0.0 }}\n"
    '[[item]]\nkind = "explore"\n'
)


def run(_rounds: int, _seconds: float) -> None:
    """Explore each world once."""
    rows = []
    for world, start in STARTS.items():
        truth = grid_of_walls(load_walls(find_world(world)), SIDE_M)
        ideal_m = _ideal_m(truth, start)
        driven_m, time_s, share = _driven(world, start, truth)
        rows.append(
            (
                world,
                f"{ideal_m:.1f}",
                f"{driven_m:.1f}",
                f"{driven_m / ideal_m:.2f}",
                f"{time_s:.0f}",
                f"{100.0 * share:.1f}",
            )
        )
    heads = ("world", "greedy ideal, m", "driven, m", "ratio", "s", "known in the end, %")
    machine.table(
        f"Exploring until {100 * SHARE:.0f} % of what can be reached is known", heads, rows
    )


def _reachable(truth: GridMap, start: SE2) -> NDArray[np.bool_]:
    """Return the free cells that hang together with the start's."""
    regions, _ = ndimage.label(truth.cells == 0)
    row, column = truth.cell_of(np.array([[start.x_m, start.y_m]]))[0]
    reachable: NDArray[np.bool_] = regions == regions[row, column]
    return reachable


def _driven(world: str, start: SE2, truth: GridMap) -> tuple[float, float, float]:
    """Return way and time until the robot knows enough, and what it knows in the end."""
    reachable = _reachable(truth, start)
    places = truth.centre_of(np.argwhere(reachable))
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "explore.toml"
        mission.write_text(MISSION.format(world=world, start=start), encoding="utf-8")
        run = LockstepRun(
            SimOptions(find_file("diff_drive"), mission, max_seconds=900.0, localisation=SLAM)
        )
        pilot = run._tick._adapter.navigator._robot.pilot  # type: ignore[union-attr]
        simulation, found, steps, share = run.stack.simulation, (math.nan, math.nan), 0, 0.0
        for control, _ in run.steps():
            steps += 1
            if steps % 20:
                continue
            space = pilot.space()  # type: ignore[union-attr]
            cells = space.grid.cell_of(places)
            inside = ((cells >= 0) & (cells < space.shape)).all(axis=1)
            known = space.grid.cells[tuple(cells[inside].T)] >= 0
            share = float(known.sum() / len(places))
            if share >= SHARE and math.isnan(found[0]):
                found = simulation.truth().distance_m, control.stamp_ns * 1e-9
    return *found, share


def _ideal_m(truth: GridMap, start: SE2) -> float:
    """Return the way of the ideal."""
    reachable = _reachable(truth, start)
    row, column = truth.cell_of(np.array([[start.x_m, start.y_m]]))[0].tolist()
    room = ndimage.distance_transform_edt(reachable) * SIDE_M
    open_cells = reachable & (room >= BODY_M)
    known = np.zeros(truth.shape, np.bool_)
    way_m = 0.0
    here = (row, column)
    _see(truth, here, known)
    while (known & reachable).sum() < SHARE * reachable.sum():
        path = _path_to_frontier(open_cells, known, here)
        if path is None:
            break
        driven_m = 0.0
        for cell in path:
            driven_m += SIDE_M * math.dist(here, cell)
            here = cell
            _see(truth, here, known)
            enough = (known & reachable).sum() >= SHARE * reachable.sum()
            if enough or driven_m >= AGAIN_M:
                break
        way_m += driven_m
    return way_m


def _see(truth: GridMap, here: tuple[int, int], known: NDArray[np.bool_]) -> None:
    """Note all cells in sight."""
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)[:, np.newaxis]
    steps = np.arange(0.0, REACH_M / SIDE_M, 0.5)
    rows = np.floor(here[0] + 0.5 + steps * np.sin(angles)).astype(int)
    columns = np.floor(here[1] + 0.5 + steps * np.cos(angles)).astype(int)
    inside = (rows >= 0) & (rows < known.shape[0]) & (columns >= 0) & (columns < known.shape[1])
    rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
    hit = (truth.cells[rows, columns] != 0) | ~inside
    seen = np.cumsum(hit, axis=1) == 0
    known[rows[seen], columns[seen]] = True


def _path_to_frontier(
    open_cells: NDArray[np.bool_], known: NDArray[np.bool_], here: tuple[int, int]
) -> list[tuple[int, int]] | None:
    """Return the cells to the nearest known one beside an unknown one that is free."""
    free = open_cells & known
    free[here] = True
    frontier = free & ndimage.binary_dilation(open_cells & ~known)
    frontier[here] = False
    if not frontier.any():
        return None
    lengths, before = dijkstra(
        _graph(free), indices=np.ravel_multi_index(here, free.shape), return_predecessors=True
    )
    there = np.flatnonzero(frontier.ravel())
    best = int(there[np.argmin(lengths[there])])
    if not math.isfinite(lengths[best]):
        return None
    path = []
    while best >= 0 and best != np.ravel_multi_index(here, free.shape):
        path.append(tuple(int(each) for each in np.unravel_index(best, free.shape)))
        best = int(before[best])
    return path[::-1]  # type: ignore[return-value]


def _graph(free: NDArray[np.bool_]) -> csr_matrix:
    """Return the steps between free cells with their lengths."""
    numbers = np.arange(free.size).reshape(free.shape)
    begins, ends, lengths = [], [], []
    rows, columns = free.shape
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        left, last = max(-right, 0), columns - max(right, 0)
        a = np.s_[: rows - down, left:last]
        b = np.s_[down:, left + right : last + right]
        both = free[a] & free[b]
        begins.append(numbers[a][both])
        ends.append(numbers[b][both])
        lengths.append(np.full(int(both.sum()), math.hypot(down, right)))
    data = np.concatenate(lengths), (np.concatenate(begins), np.concatenate(ends))
    graph = csr_matrix(data, shape=(free.size, free.size))
    return graph + graph.T
