"""A path through a map, and its figures: the work of `robotctl plan`."""

from __future__ import annotations

import csv
import json
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast, get_args

import numpy as np
from numpy.typing import NDArray

from robotctl.config.robot_file import RobotConfig, find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.maps.localisation_map import load_any_map
from robotctl.maps.mask_file import load_masks
from robotctl.maps.moving_ai import is_moving_ai, load_moving_ai
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.map.doors import doors_of
from robotctl.planning.map.mask import Mask
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.map.zones import Closed, path_prices, speed_limits
from robotctl.planning.path.global_planning.goal import facing
from robotctl.planning.path.global_planning.plan import (
    Plan,
    PlanFailure,
    Planner,
    PlannerConfig,
    Steering,
    dense,
)
from robotctl.planning.path.global_planning.planners import PLANNERS, planner_config, planner_of
from robotctl.toml_source import nearest
from robotctl.workbench.planning.options import PlanOptions

DEFAULT_ROBOT: Final = "diff_drive"
_STEP: Final = 0.5
"""Spacing of the places of a path at which its clearance is taken [cells]."""
_ROUNDS: Final = 20
"""How often a planner may ask to go on, when it is to compile its loops."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """A plan or a failure, with its inputs.

    Parameters
    ----------
    options, space
        What was asked for, and the map.
    planner, config
        Name of the planner, and how it chooses paths.
    answer
        The path, or why there is none.
    time_ms
        Of the search [ms], without reading the map.
    """

    options: PlanOptions
    space: PlanningMap
    planner: str
    config: PlannerConfig
    answer: Plan | PlanFailure
    time_ms: float

    @property
    def is_cells(self) -> bool:
        """Whether the map is one of MovingAI, with lengths in cells."""
        return is_moving_ai(Path(self.options.map))

    @property
    def path(self) -> NDArray[np.float64]:
        """The poses, (n, 3), in `world`; on a MovingAI map column, row and heading. May be none."""
        if isinstance(self.answer, PlanFailure):
            return np.empty((0, 3))
        return self._as_cells(self.answer.poses) if self.is_cells else self.answer.poses

    def _as_cells(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = self.space.shape[0]
        return np.column_stack([poses[:, 0] - 0.5, rows - 0.5 - poses[:, 1], -poses[:, 2]])

    def report(self) -> dict[str, Any]:
        """Return the figures."""
        answer = self.answer
        if isinstance(answer, PlanFailure):
            place = None if answer.place is None else [round(each, 3) for each in answer.place]
            return {
                "found": False,
                "length_m": None,
                "cost": None,
                "expanded": answer.expanded,
                "time_ms": round(self.time_ms, 3),
                "min_clearance_m": None,
                "reason": answer.text,
                "code": answer.reason.value,
                "place": place,
            }
        return {
            "found": True,
            "length_m": answer.length_m,
            "cost": answer.cost,
            "expanded": answer.expanded,
            "time_ms": round(self.time_ms, 3),
            "min_clearance_m": min_clearance_m(self.space, answer),
            "reason": "",
        }


def make_plan(options: PlanOptions) -> PlanResult:
    """Read map and robot, and plan.

    Raises
    ------
    ConfigError
        If a file, a place or a name is wrong.
    """
    steering = _steering(options.steering)
    if not 0.0 < options.time_limit_s < math.inf:
        raise ConfigError(f"--time-limit {options.time_limit_s:g}: a number of seconds above 0")
    path, name, named_by = Path(options.map), options.planner or "astar", "--planner"
    if is_moving_ai(path):
        grid = load_moving_ai(path)
        space = PlanningMap(grid, Footprint())
        start, goal = (_cell(grid, name, getattr(options, name)) for name in ("start", "goal"))
        if steering not in (None, "straight"):
            raise ConfigError(
                f"--steering {steering}: on a MovingAI map, where the robot is a point, "
                "straight is allowed"
            )
        config = PlannerConfig(margin_m=0.0, comfort_m=0.0, any_angle=False, seed=options.seed)
    else:
        file = find_file(options.robot or DEFAULT_ROBOT)
        robot = load_robot(file, options.overrides)
        grid = load_any_map(options.map, Path(), robot.navigation.map.cell_m).grid
        space = _space(grid, robot, load_masks(robot.navigation.pilot.mask, file.resolve().parent))
        start, goal = (_pose(name, getattr(options, name)) for name in ("start", "goal"))
        goal = goal if len(options.goal) == 3 else facing(start, goal.x_m, goal.y_m)
        pilot, drive = robot.navigation.pilot, robot.drive
        if not options.planner:
            name, named_by = planner_of(pilot, drive), f"{file}: navigation.pilot.planner"
        config = planner_config(pilot, drive, space.footprint, drive.min_turning_radius_m)
        config = replace(config, seed=options.seed, steering=steering or config.steering)
    if name not in PLANNERS:
        hint = nearest(name, list(PLANNERS))
        raise ConfigError(f"{named_by} {name}: there is no such planner{hint}")
    planner = PLANNERS[name](config)
    _compile(planner, space.footprint)
    begin_s = time.perf_counter()
    answer = planner.plan(
        space, start, goal, lambda: time.perf_counter() - begin_s < options.time_limit_s
    )
    return PlanResult(options, space, name, config, answer, 1e3 * (time.perf_counter() - begin_s))


def _space(grid: GridMap, robot: RobotConfig, masks: tuple[Mask, ...]) -> PlanningMap:
    """Return a map for a robot, with the zones of its file and its masks."""
    door_m = robot.navigation.journey.people.door_m
    doors = doors_of(grid, robot.footprint.inscribed_m, door_m)
    closed = Closed(robot.navigation.pilot.zone, masks=masks, doors=doors)
    cells = grid.cells.copy()
    cells[closed.cells(grid)] = OCCUPIED
    known = GridMap(cells, grid.resolution_m, grid.origin)
    space = PlanningMap(known, robot.footprint)
    space.closed = closed
    full_speed_m_s = robot.limits.v_max_m_s
    limits_m_s = speed_limits(grid, closed, full_speed_m_s)
    space.slowness = path_prices(grid, closed, limits_m_s, full_speed_m_s)
    return space


def _steering(name: str) -> Steering | None:
    """Return what the user asks for; None: as the robot drives."""
    for each in get_args(Steering):
        if name == each:
            return cast("Steering", each)
    if name:
        allowed = ", ".join(get_args(Steering))
        raise ConfigError(f"--steering {name}: {allowed} are allowed")
    return None


def _compile(planner: Planner, footprint: Footprint) -> None:
    """Let a planner compile its loops, which is not part of its time, on a small map.

    One that makes its path better as long as it may is asked for a few rounds only.
    """
    side_m = max(footprint.reach_m, 1.0)
    cells = np.zeros((13, 13), np.int8)
    cells[:9, 6] = 100
    start, goal = (SE2(x * side_m, 2.5 * side_m, 0.0) for x in (2.5, 10.5))
    rounds = iter(range(_ROUNDS))
    space = PlanningMap(GridMap(cells, side_m), footprint)
    planner.plan(space, start, goal, lambda: next(rounds, None) is not None)


def min_clearance_m(space: PlanningMap, plan: Plan) -> float:
    """Return the smallest gap between the body and blocked cells along a path [m]."""
    path = dense(plan.poses, _STEP * space.grid.resolution_m)
    return float(space.gaps_m(space.poses_to_cells(path)).min())


def write_path(result: PlanResult, file: Path) -> None:
    """Write the poses as CSV: x_m, y_m, theta_deg, or column, row, theta_deg."""
    names = ("column", "row") if result.is_cells else ("x_m", "y_m")
    with file.open("w", encoding="utf-8", newline="") as output:
        writer = csv.writer(output, lineterminator="\n")
        writer.writerow((*names, "theta_deg"))
        for x, y, theta in result.path.tolist():
            writer.writerow((f"{x:.6g}", f"{y:.6g}", f"{math.degrees(theta):.3f}"))


def write_report(result: PlanResult, file: Path) -> None:
    """Write the figures as JSON."""
    file.write_text(json.dumps(result.report(), indent=2) + "\n", encoding="utf-8")


def _pose(name: str, numbers: tuple[float, ...]) -> SE2:
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"--{name}: {_words(numbers)} found; x,y or x,y,deg is allowed")
    heading_deg = numbers[2] if len(numbers) == 3 else 0.0
    return SE2(numbers[0], numbers[1], math.radians(heading_deg))


def _cell(grid: GridMap, name: str, numbers: tuple[float, ...]) -> SE2:
    """Return the centre of a cell of a MovingAI map, counted from the top left."""
    if len(numbers) not in (2, 3) or not all(number.is_integer() for number in numbers[:2]):
        raise ConfigError(
            f"--{name}: {_words(numbers)} found; on a MovingAI map column,row from the top left "
            "are allowed"
        )
    return SE2(numbers[0] + 0.5, grid.shape[0] - 0.5 - numbers[1], 0.0)


def _words(numbers: tuple[float, ...]) -> str:
    return ",".join(f"{number:g}" for number in numbers) or "nothing"
