"""Items of a mission that lead into a zone that the same mission keeps the robot out of."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from robotctl.planning.behave.behaviours.circle import CircleItem
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.item import Item
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.mission.flow import ItemProblem
from robotctl.planning.map.zone import Point, Zone


def zone_problems(items: Sequence[Item], zones: Sequence[Zone]) -> Iterator[ItemProblem]:
    """Yield the items that no planner leads round a keep-out zone, or whose goal is in one."""
    for index, item in enumerate(items):
        for zone in zones:
            if zone.speed_m_s > 0.0:
                continue
            match item:
                case DriveItem() if _leads_through(item.waypoints, zone):
                    yield ItemProblem(
                        index, "waypoints", f"lead through the keep-out zone {zone.name}"
                    )
                case CircleItem() if _leads_through(item.outline(), zone):
                    yield ItemProblem(
                        index, "radius_m", f"leads through the keep-out zone {zone.name}"
                    )
                case GotoItem() | StraightToItem() if zone.contains((item.x_m, item.y_m)):
                    yield ItemProblem(index, "x_m", f"the goal is in the keep-out zone {zone.name}")


def _leads_through(points: Sequence[Point], zone: Zone) -> bool:
    pairs = itertools.pairwise(points)
    return zone.contains(points[0]) or any(zone.is_entered(a, b) for a, b in pairs)
