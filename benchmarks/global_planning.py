"""Global planners beside others' on the same maps, in turn.

Peers are measured where they are installed: `uv pip install pyastar2d tcod ompl`. ROBOTCTL_DATA
names the folder of MovingAI's maps and of nav2's.
"""

from __future__ import annotations

import gzip
import math
import os
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine
from robotctl.config.robot_file import config_directory, load_robot
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.maps.map_file import load_map
from robotctl.maps.moving_ai import load_moving_ai
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.grid_search import octile_length, search_cells
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS

SIZE = 1000
FREE = np.where(np.arange(256) < 253, 1.0, math.inf)
SEEDS = 10
WAREHOUSE = (
    ((-10.5, -20.0, 90.0), (12.0, 20.0, 0.0)),
    ((-13.5, -22.0, 0.0), (-8.0, 23.0, 90.0)),
    ((13.0, -23.0, 90.0), (-13.0, 15.0, 90.0)),
)
"""Start and goal, m and degrees."""


def run(rounds: int, _seconds: float) -> None:
    """Measure all."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    _grids(rounds)
    if (folder / "movingai").is_dir():
        _published(folder / "movingai")
        _rooms(folder / "movingai")
    else:
        machine.note(f"movingai: not measured, no {folder / 'movingai'}; set ROBOTCTL_DATA")
    _office()
    if (folder / "maps").is_dir():
        _warehouse(folder / "maps", rounds)
    else:
        machine.note(f"warehouse: not measured, no {folder / 'maps'}; set ROBOTCTL_DATA")


def boxes(seed: int) -> np.ndarray:
    """Return a map with random boxes, free in two corners."""
    rng = np.random.default_rng(seed)
    grid = np.zeros((SIZE, SIZE), np.uint8)
    for _ in range(200):
        (height, width), (row, column) = rng.integers(10, 60, 2), rng.integers(0, SIZE, 2)
        grid[row : row + height, column : column + width] = 254
    grid[:90, :90] = grid[-90:, -90:] = 0
    return grid


def comb() -> np.ndarray:
    """Return a map with corridors, each open to the next at one end, by turns."""
    grid = np.zeros((SIZE, SIZE), np.uint8)
    for i, column in enumerate(range(20, SIZE - 20, 20)):
        grid[:, column] = 254
        grid[slice(3) if i % 2 else slice(-3, None), column] = 0
    return grid


def noise(seed: int) -> np.ndarray:
    """Return a map with single obstacles in 30 % of its cells, free in two corners."""
    grid = np.where(np.random.default_rng(seed).random((SIZE, SIZE)) < 0.3, 254, 0).astype(np.uint8)
    grid[:5, :5] = grid[-5:, -5:] = 0
    return grid


def _peers(grid: np.ndarray) -> dict[str, Callable[[], Any]]:
    """Return the peers that are installed, each as a search from corner to corner."""
    free = grid < 253
    peers: dict[str, Callable[[], Any]] = {}
    if find_spec("pyastar2d"):
        pyastar2d = import_module("pyastar2d")
        weights = np.where(free, 1, np.inf).astype(np.float32)
        last = (SIZE - 1, SIZE - 1)
        peers["pyastar2d"] = lambda: pyastar2d.astar_path(weights, (0, 0), last, True)
    if find_spec("tcod"):
        tcod = import_module("tcod.path")
        peers["tcod"] = lambda: tcod.path2d(
            free.astype(np.int8),
            start_points=[(0, 0)],
            end_points=[(SIZE - 1, SIZE - 1)],
            cardinal=10000,
            diagonal=14142,
        )
    for name in {"pyastar2d", "tcod"} - peers.keys():
        machine.note(f"{name}: not measured, it is not installed")
    return peers


def _cells(grid: np.ndarray, *, guided: bool) -> Any:
    """Return the cells of a path from corner to corner."""
    return search_cells(grid, FREE, (0, 0), (SIZE - 1, SIZE - 1), guided=guided).cells


def _grids(rounds: int) -> None:
    rows = []
    maps = {"boxes 1": boxes(1), "boxes 2": boxes(2), "comb": comb(), "noise": noise(1)}
    for title, grid in maps.items():
        works = {
            "robotctl": partial(_cells, grid, guided=True),
            "its Dijkstra": partial(_cells, grid, guided=False),
        }
        if title.startswith("boxes"):  # peers cut corners: through noise that is another problem
            works |= _peers(grid)
        times: dict[str, list[float]] = {name: [] for name in works}
        paths = {name: work() for name, work in works.items()}
        for _ in range(rounds):
            for name, work in works.items():
                began = time.perf_counter()
                work()
                times[name].append(1e3 * (time.perf_counter() - began))
        own = machine.median(times["robotctl"])
        for name in works:
            ratio = machine.median(times[name]) / own
            length = octile_length(np.asarray(paths[name], np.int64))
            rows.append((title, name, machine.spread(times[name], 1), f"{ratio:.2f}",
                         f"{length:.2f}"))  # fmt: skip
    heads = ("map", "planner", "ms", "times robotctl", "length, cells")
    machine.table("A* on 1000 x 1000 cells, corner to corner", heads, rows)


def _problems(folder: Path, name: str) -> list[list[str]]:
    text = gzip.decompress((folder / f"{name}.map.scen.gz").read_bytes()).decode()
    return [line.split("\t") for line in text.splitlines()[1:] if "\t" in line]


def _published(folder: Path) -> None:
    rows = []
    for path in sorted(folder.glob("*.map.gz")):
        name = path.name.removesuffix(".map.gz")
        grid = load_moving_ai(path)
        costs = np.where(grid.occupied(), 254, 0).astype(np.uint8)[::-1]
        worst, problems = 0.0, _problems(folder, name)
        began = time.perf_counter()
        for words in problems:
            x0, y0, x1, y1 = map(int, words[4:8])
            found = search_cells(np.ascontiguousarray(costs), FREE, (y0, x0), (y1, x1))
            worst = max(worst, abs(found.cost - float(words[8])))
        spent_s = time.perf_counter() - began
        rows.append(
            (name, str(len(problems)), f"{worst:.1e}", f"{1e3 * spent_s / len(problems):.2f}")
        )
    heads = ("map", "problems", "greatest difference, cells", "ms a problem")
    machine.table("A* and MovingAI's published lengths, all problems", heads, rows)


def _rooms(folder: Path) -> None:
    words = _problems(folder, "32room_000")[-1]
    space = PlanningMap(load_moving_ai(folder / "32room_000.map.gz"), Footprint())
    rows_of_map = space.shape[0]
    ends = [SE2(int(words[i]) + 0.5, rows_of_map - 0.5 - int(words[i + 1]), 0.0) for i in (4, 6)]
    _trees("32room_000, the hardest problem", space, ends, float(words[8]), 10.0)


def _office() -> None:
    robot = load_robot(config_directory() / "diff_drive.toml")
    grid = load_localisation_map("office", Path()).grid
    space = PlanningMap(grid, robot.footprint)
    ends = [SE2(1.0, 4.0, 0.0), SE2(20.0, 11.0, 1.57)]
    best = PLANNERS["astar"](PlannerConfig(comfort_weight=0.0)).plan(space, *ends)
    assert isinstance(best, Plan)
    _trees("office", space, ends, best.length_m, 10.0)


def _trees(title: str, space: PlanningMap, ends: list[SE2], best: float, limit_s: float) -> None:
    rows = []
    for name in ("rrt", "rrt-connect", "rrtstar"):
        times, ratios = [], []
        for seed in range(-1, SEEDS):
            config = PlannerConfig(seed=max(seed, 0), margin_m=0.0 if best > 100 else 0.05)
            began = time.perf_counter()
            answer = PLANNERS[name](config).plan(
                space, *ends, lambda began=began: time.perf_counter() - began < limit_s
            )
            if seed >= 0:  # the first is compiled
                times.append(1e3 * (time.perf_counter() - began))
                ratios.append(answer.length_m / best if isinstance(answer, Plan) else math.nan)
        found = sum(not math.isnan(each) for each in ratios)
        rows.append(
            (name, f"{found} of {SEEDS}", machine.spread(times, 0), machine.spread(ratios, 2))
        )
    if find_spec("ompl"):
        rows.append(_ompl(space, ends, best, limit_s))
    else:
        machine.note("ompl: not measured, it is not installed")
    heads = ("planner", "found", "ms", "length / that of A*")
    machine.table(f"Random trees: {title}", heads, rows)


def _ompl(
    space: PlanningMap, ends: list[SE2], best: float, limit_s: float
) -> tuple[str, str, str, str]:
    """Return the row of OMPL's RRT-Connect with its simplification, for the same circle."""
    ob, og, ou = (import_module(f"ompl.{name}") for name in ("base", "geometric", "util"))
    ou.setLogLevel(ou.LOG_NONE)
    rows, columns = space.shape
    radius = space.circumscribed + (0.0 if best > 100 else 0.05 / space.grid.resolution_m)
    clearance = space.clearance.tolist()  # faster to index from Python

    def is_valid(state: Any) -> bool:
        x, y = state[0], state[1]
        return 0.0 <= x < columns and 0.0 <= y < rows and clearance[int(y)][int(x)] >= radius

    times, ratios = [], []
    for _ in range(SEEDS):
        plane = ob.RealVectorStateSpace(2)
        bounds = ob.RealVectorBounds(2)
        for axis, high in enumerate((columns, rows)):
            bounds.setLow(axis, 0.0)
            bounds.setHigh(axis, float(high))
        plane.setBounds(bounds)
        plane.setLongestValidSegmentFraction(0.5 / math.hypot(rows, columns))
        setup = og.SimpleSetup(plane)
        setup.setStateValidityChecker(is_valid)
        begin, goal = plane.allocState(), plane.allocState()
        for state, end in zip((begin, goal), map(space.to_cells, ends), strict=True):
            state[0], state[1] = end.x_m, end.y_m
        setup.setStartAndGoalStates(begin, goal)
        setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
        began = time.perf_counter()
        found = setup.solve(limit_s) and setup.haveExactSolutionPath()
        if found:
            setup.simplifySolution()
        times.append(1e3 * (time.perf_counter() - began))
        length_m = setup.getSolutionPath().length() * space.grid.resolution_m if found else math.nan
        ratios.append(length_m / best)
    found = sum(not math.isnan(each) for each in ratios)
    return (
        "OMPL, rrt-connect", f"{found} of {SEEDS}", machine.spread(times, 0),
        machine.spread(ratios, 2),
    )  # fmt: skip


def _warehouse(folder: Path, rounds: int) -> None:
    robot = load_robot(config_directory() / "ackermann.toml")
    grid: GridMap = load_map(folder / "warehouse.yaml")
    space = PlanningMap(grid, robot.footprint)
    config = PlannerConfig(turning_radius_m=robot.drive.min_turning_radius_m)
    rows = []
    for start, goal in WAREHOUSE:
        times: list[float] = []
        for _ in range(rounds + 1):
            began = time.perf_counter()
            answer = PLANNERS["hybrid"](config).plan(
                space, *(SE2(x, y, math.radians(deg)) for x, y, deg in (start, goal))
            )
            times.append(1e3 * (time.perf_counter() - began))
        length = f"{answer.length_m:.1f}" if isinstance(answer, Plan) else answer.text
        rows.append((f"{start} to {goal}", length, machine.spread(times[1:], 0)))
    machine.table("Hybrid A* in nav2's warehouse, Ackermann", ("problem", "length, m", "ms"), rows)
