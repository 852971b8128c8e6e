"""Best possible run of a simulated robot: the shortest path at the speed that is allowed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_sim.world.world import World
from robotctl.config.robot_file import RobotConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, GridMap
from robotctl.model.wall_map import WallMap
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.wait import WaitItem
from robotctl.planning.behave.mission.mission_file import Mission


class Best(NamedTuple):
    """The best path."""

    length_m: float
    time_s: float
    """At the largest speed that is allowed all along, without turns on the spot [s]; with waits."""


def best_path(robot: RobotConfig, room: World, start: SE2, mission: Mission) -> Best | None:
    """Return the best path from goal to goal of a mission.

    None if the mission has anything but goals and waits, or the planner, which knows all that
    stands there but no people and no zones, finds no path. That of a robot that steers is up to
    15 % longer than the shortest one.
    """
    goals = [item for item in mission.item if isinstance(item, GotoItem)]
    waits = [item for item in mission.item if isinstance(item, WaitItem)]
    if not goals or len(goals) + len(waits) < len(mission.item):
        return None
    # numba and scipy take a while to load.
    from robotctl.planning.map.planning_map import PlanningMap  # noqa: PLC0415
    from robotctl.planning.path.global_planning.goal import facing  # noqa: PLC0415
    from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig  # noqa: PLC0415
    from robotctl.planning.path.global_planning.planners import PLANNERS  # noqa: PLC0415

    outline = robot.footprint
    space = PlanningMap(_floor(room), outline)
    planner = PLANNERS["hybrid" if robot.drive.steered else "astar"](
        PlannerConfig(
            margin_m=robot.navigation.pilot.margin_m,
            comfort_weight=0.0,
            turning_radius_m=robot.drive.min_turning_radius_m or outline.inscribed_m,
        )
    )
    here, length_m, time_s = start, 0.0, sum(wait.duration_s for wait in waits)
    for goal in goals:
        there = facing(here, goal.x_m, goal.y_m)
        if goal.heading_deg is not None:
            there = SE2(goal.x_m, goal.y_m, math.radians(goal.heading_deg))
        plan = planner.plan(space, here, there)
        if not isinstance(plan, Plan):
            return None
        speed_m_s = goal.speed_m_s or robot.navigation.guided_speed_m_s
        length_m += plan.length_m
        time_s += plan.length_m / min(speed_m_s, robot.limits.v_max_m_s)
        here = there
    return Best(length_m, time_s)


def _floor(room: World) -> GridMap:
    """Return what stands in a world as a grid of all of it, whether walls enclose it or not."""
    from robotctl.estimation.grid.wall_raster import grid_of_walls  # noqa: PLC0415

    walls = grid_of_walls(WallMap(room.touchable))
    side_m, origin, (rows, columns) = walls.resolution_m, walls.origin, walls.shape
    low_x, low_y, high_x, high_y = room.bounds
    below = _cells(origin.y_m - low_y, side_m), _cells(origin.x_m - low_x, side_m)
    above = (
        _cells(high_y - origin.y_m - rows * side_m, side_m),
        _cells(high_x - origin.x_m - columns * side_m, side_m),
    )
    occupied = np.pad(walls.occupied(), list(zip(below, above, strict=True)))
    cells = np.where(occupied, OCCUPIED, FREE).astype(np.int8)
    corner = SE2(origin.x_m - below[1] * side_m, origin.y_m - below[0] * side_m, 0.0)
    return GridMap(cells, side_m, corner)


def _cells(length_m: float, side_m: float) -> int:
    """Return how many cells a length takes; none if it is negative."""
    return max(math.ceil(length_m / side_m), 0)
