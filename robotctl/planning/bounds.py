"""Bounds set by people: fence, zones and rally points."""

from __future__ import annotations

from collections.abc import Sequence

from robotctl.errors import MissionError
from robotctl.model.fence import Fence, Point
from robotctl.planning.behave.behaviours.goto import NO_PILOT
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.map.zone import Zone


class Bounds:
    """Keeps the robot's pilot, which may come later, within the fence and the zones.

    Parameters
    ----------
    robot
        The robot that is bound.
    """

    def __init__(self, robot: NavigatedRobot) -> None:
        self._robot = robot
        self._fence = Fence()

    @property
    def own_zones(self) -> tuple[Zone, ...]:
        """Zones of the robot's file, which count if it plans."""
        return () if self._robot.pilot is None else self._robot.config.pilot.zone

    def brief_pilot(self) -> None:
        """Give a new pilot the fence."""
        if self._robot.pilot is not None:
            self._robot.pilot.use_fence(self._fence)

    def use_fence(self, fence: Fence) -> None:
        """Plan within a fence."""
        self._fence = fence
        self.brief_pilot()

    def use_drawn_zones(self, zones: Sequence[Zone]) -> None:
        """Plan round, or slowly through, the zones that people have drawn.

        Raises
        ------
        MissionError
            If the robot plans nothing.
        """
        if self._robot.pilot is None:
            raise MissionError(f"zones: {NO_PILOT}")
        self._robot.pilot.use_drawn_zones(zones)

    def use_rally(self, places: tuple[Point, ...]) -> None:
        """Return to the nearest of these from now on, if there are some and it plans its way."""
        self._robot.rally = places
