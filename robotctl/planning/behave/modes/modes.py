"""The robot's modes together: which one steers, and what leads from one to another."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.mode import Mode
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.relocalise import LookAround
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.planning.behave.modes.auto import Auto
from robotctl.planning.behave.modes.drive_mode import DriveMode
from robotctl.planning.behave.modes.guided import Guided
from robotctl.planning.behave.modes.hold import Hold
from robotctl.planning.behave.modes.manual import Manual
from robotctl.planning.behave.modes.rtl import ReturnToLaunch


class Modes:
    """Lets the present mode steer, or the search for the robot's pose while that is lost.

    Parameters
    ----------
    mission
        What AUTO does; None: AUTO is refused.
    robot
        The robot that drives.
    limits
        Speed limits; they scale the sticks.

    Attributes
    ----------
    mode
        The present mode.
    hold, manual, guided, auto
        What steers in these modes.
    look_around
        What steers while the pose is lost.
    is_searching
        Whether the pose was lost on the way to somewhere, as of the last step.

    Raises
    ------
    MissionError
        If the robot cannot drive the mission; one line for each item.
    """

    def __init__(
        self, mission: Mission | None, robot: NavigatedRobot, limits: LimitsConfig
    ) -> None:
        self._robot = robot
        self.mode = Mode.HOLD
        self.hold = Hold()
        self.manual = Manual(robot.drive, limits)
        self.guided = Guided(robot)
        self.auto = Auto(mission, robot)
        self._by_mode: Final[Mapping[Mode, DriveMode]] = {
            Mode.HOLD: self.hold,
            Mode.MANUAL: self.manual,
            Mode.GUIDED: self.guided,
            Mode.AUTO: self.auto,
            Mode.RTL: ReturnToLaunch(robot),
        }
        self.look_around = LookAround(
            robot.drive, robot.guard, robot.mounts, robot.config.look_around_speed_m_s
        )
        self.is_searching = False

    @property
    def present(self) -> DriveMode:
        """Steering of the present mode."""
        return self._by_mode[self.mode]

    @property
    def held_because(self) -> str:
        """Why the robot itself went to HOLD, where it still is; empty: it did not."""
        return self.hold.reason if self.mode is Mode.HOLD else ""

    def refusal(self, mode: Mode) -> str:
        """Return why the robot cannot drive in a mode, empty if it can."""
        if mode is Mode.AUTO and self.auto.mission is None:
            return "no mission is loaded"
        if mode is Mode.RTL and self._robot.crumbs.has_gap and not self._robot.plans_home:
            return "the path home is not known: navigation started, or lost its place, on it"
        return ""

    def change(self, mode: Mode) -> None:
        """Leave the present mode and begin another, or the same one from its start."""
        self.pause()
        self.mode = mode
        self.use_reverse(reverse=False)
        self.present.begin()

    def fall_back(self, reason: str) -> None:
        """Go to HOLD for a reason of the robot's own."""
        self.change(Mode.HOLD)
        self.hold.reason = f"hold: {reason}"

    def use_reverse(self, *, reverse: bool) -> None:
        """Drive to places in reverse from now on, or ahead again."""
        self._robot.reverse = reverse
        if self._robot.pilot is not None:
            self._robot.pilot.use_reverse(reverse=reverse)

    def pause(self) -> None:
        """Stop what steers, and its time."""
        self.look_around.pause()
        self.present.pause()

    def step(self, situation: BehaviourInput, now_ns: int, *, localised: bool) -> BehaviourOutput:
        """Return the velocity at `now_ns`, monotonic [ns].

        What drives to somewhere in the world needs a pose there: the robot looks around for it.
        """
        searches = not localised and self.present.is_under_way
        if searches and not self.is_searching:
            self.present.pause()
            self.look_around.reset()
            self.present.relocate()
        self.is_searching = searches
        if searches:
            return self.look_around.step(situation)
        return self.present.step(situation, now_ns)
