"""Paths for robots that steer: hybrid-state A* with the robot's turning circle and its body.

It leads straight through narrow places, where they are straight: the search is cheapest where it
bends up to the very door, and then the robot has no room for an error.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.curves import along
from robotctl.planning.path.global_planning.gates import gated
from robotctl.planning.path.global_planning.hybrid_search import (
    ENDED,
    ENTRY,
    EXPANDED,
    FULL,
    GOING_ON,
    LAST,
    Nodes,
    SearchSpace,
    begin,
    cost_to_go,
    drive,
    expand,
    make_nodes,
    price_cells,
)
from robotctl.planning.path.global_planning.obstructions import blocked_ends, no_path
from robotctl.planning.path.global_planning.plan import (
    GoesOn,
    Plan,
    PlanFailure,
    PlannerConfig,
    Reason,
    dense,
    joined,
)

_COARSE_M: Final = 0.1
"""Side of a cell in which one pose of each heading is kept."""
_CAPACITY: Final = 2_000_000
_PIECE: Final = 2000
"""Nodes expanded between two looks at the time: some 10 ms."""
_SPACING: Final = 1.0
"""Spacing of the poses of a path [cells]."""


class HybridPlanner:
    """Hybrid-state A*.

    Parameters
    ----------
    config
        How paths are chosen; its turning radius counts.
    """

    def __init__(self, config: PlannerConfig | None = None) -> None:
        self._config = config or PlannerConfig()

    def plan(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn = lambda: True
    ) -> Plan | PlanFailure:
        """Return a path that the robot can drive, or why there is none."""
        found = self._search(space, start, goal, goes_on)
        if isinstance(found, PlanFailure):
            return found
        return self._through_gates(space, found, start, goal, goes_on) or found

    def _through_gates(
        self, space: PlanningMap, found: Plan, start: SE2, goal: SE2, goes_on: GoesOn
    ) -> Plan | None:
        """Return a path straight through the narrow places of another; None: there is none."""
        side_m = space.grid.resolution_m
        cells = np.floor(space.poses_to_cells(found.poses)[:, 1::-1]).astype(np.int64)
        gates = [
            gate
            for gate in gated(cells, space, self._config.margin_m)
            if not found.reverse[gate.first : gate.last].any()
        ]
        if not gates:
            return None
        here = start
        parts: list[Plan | PlanFailure] = []
        for gate in gates:
            (x0, y0), (x1, y1) = gate.ends.tolist()
            angle = math.atan2(y1 - y0, x1 - x0)
            ends = space.to_world(np.array([[x0, y0, angle], [x1, y1, angle]]))
            through_m = math.dist((x0, y0), (x1, y1)) * side_m
            parts.append(self._search(space, here, SE2(*ends[0].tolist()), goes_on))
            parts.append(Plan(dense(ends, side_m), through_m, 0))
            here = SE2(*ends[1].tolist())
        parts.append(self._search(space, here, goal, goes_on))
        plans = [part for part in parts if isinstance(part, Plan)]
        return joined(plans) if len(plans) == len(parts) else None

    def _search(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn
    ) -> Plan | PlanFailure:
        """Return the cheapest path that the robot can drive, or why there is none."""
        failure = blocked_ends(space, start, goal)
        if failure is not None:
            return failure
        ends = [
            np.array([end.x_m, end.y_m, end.theta_rad])
            for end in (space.to_cells(start), space.to_cells(goal))
        ]
        world = self._world(space, ends[1])
        nodes = make_nodes(world.to_go.shape, _CAPACITY)
        begin(world, nodes, ends[0])
        if not nodes.counts[ENTRY]:
            return no_path(space, start, goal, 0)
        # An arc that is longer than the diagonal leaves its cell for sure.
        step, status = 1.5 * world.side, GOING_ON
        while status == GOING_ON:
            status = expand(world, nodes, ends[1], step, _PIECE)
            if status == GOING_ON and not goes_on():
                break
        expanded = int(nodes.counts[EXPANDED])
        if nodes.found[0] < math.inf:
            poses, reverse = _path(world, nodes, step)
            cost_m = float(nodes.found[0]) * space.grid.resolution_m
            return Plan(space.to_world(poses), cost_m, expanded, reverse)
        failure = no_path(space, start, goal, expanded)
        if status == ENDED or failure.reason is not Reason.NOT_FOUND:
            return failure
        text = "the time was over" if status != FULL else "the search needs more memory than it has"
        return PlanFailure(Reason.OUT_OF_TIME, f"{text}: {failure.text}", failure.place, expanded)

    def _world(self, space: PlanningMap, goal: NDArray[np.float64]) -> SearchSpace:
        """Return the map with prices, and the remaining cost to the goal from each coarse cell."""
        config, side_m = self._config, space.grid.resolution_m
        factor = max(1, round(_COARSE_M / side_m))
        prices, coarse = price_cells(
            space.clearance,
            space.zone_prices(),
            max(space.inscribed - 1.0, 0.0),
            space.inscribed + config.margin_m / side_m,
            config.comfort_m / side_m,
            config.comfort_weight,
            factor,
        )
        to_go = cost_to_go(coarse, int(goal[1]) // factor, int(goal[0]) // factor)
        radius = config.turning_radius_m / side_m
        return SearchSpace(
            space.blocked, space.clearance, prices, space.samples, space.discs,
            to_go, float(factor), radius, space.circumscribed / radius,
        )  # fmt: skip


def _path(
    world: SearchSpace, nodes: Nodes, step: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the poses of the path that was found, and the gear of each piece between them."""
    chain = [int(nodes.counts[LAST]) - 1]
    while nodes.parent[chain[-1]] >= 0:
        chain.append(int(nodes.parent[chain[-1]]))
    poses, reverse = [nodes.pose[chain[-1]]], []
    count = math.ceil(step / _SPACING)
    for a, b in zip(chain[::-1], chain[-2::-1], strict=False):
        gear = int(nodes.gear[b])
        curvature = float(nodes.steering[b]) / world.radius
        for i in range(1, count + 1):
            x, y, theta = nodes.pose[a].tolist()
            poses.append(np.array(drive(x, y, theta, curvature, gear * step * i / count)))
            reverse.append(gear < 0)
    x, y, theta = poses[-1]
    curve, gears = along(nodes.curve, world.radius, _SPACING)
    c, s = math.cos(theta), math.sin(theta)
    for (px, py, angle), gear in zip(curve[1:], gears[1:], strict=True):
        poses.append(np.array([x + c * px - s * py, y + s * px + c * py, theta + angle]))
        reverse.append(gear < 0)
    return np.array(poses), np.array(reverse, np.bool_)
