"""Mode RTL: the robot returns home, or to a rally point."""

from __future__ import annotations

from robotctl.messages.mode import Mode
from robotctl.model.fence import Point
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput, Status
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.registry import behaviour_for
from robotctl.planning.behave.behaviours.rejoin import Rejoining
from robotctl.planning.behave.modes.drive_mode import DriveMode


class ReturnToLaunch(DriveMode):
    """Drives home, and stands there.

    Parameters
    ----------
    robot
        The robot that returns.
    """

    def __init__(self, robot: NavigatedRobot) -> None:
        self._robot = robot
        self._behaviour: Rejoining | None = None
        self._ended = ""

    @property
    def is_under_way(self) -> bool:
        """Whether it still drives."""
        return self._behaviour is not None

    @property
    def goal(self) -> Point | None:
        """Home in `world` [m]; None: it has arrived, or drives to one of several rally points."""
        if self._behaviour is None or self._robot.rally:
            return None
        home = self._robot.crumbs.home
        return home.x_m, home.y_m

    def begin(self) -> None:
        """Set off for home."""
        self._behaviour, self._ended = behaviour_for(Mode.RTL, self._robot), ""

    def pause(self) -> None:
        """Stop on the way, and its time."""
        if self._behaviour is not None:
            self._behaviour.pause()

    def relocate(self) -> None:
        """Continue from where the robot is found."""
        if self._behaviour is not None:
            self._behaviour.relocate()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the velocity on the way home; rest once that has ended."""
        if self._behaviour is not None:
            step = self._behaviour.step(situation, now_ns)
            if step.status is Status.RUNNING:
                return step
            self._behaviour, self._ended = None, step.text or "arrived"
        return BehaviourOutput(0.0, 0.0, text=self._ended)
