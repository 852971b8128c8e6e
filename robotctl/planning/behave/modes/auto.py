"""Mode AUTO: the mission, if there is one, and what operators ask of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from robotctl.errors import MissionError
from robotctl.messages.requests import AbortRequest, GoAheadRequest, JumpRequest
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.registry import kind_of
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.planning.behave.mission.runner import MissionRunner
from robotctl.planning.behave.modes.drive_mode import DriveMode


class MissionProgress(NamedTuple):
    """How far the mission is; the fields of `NavigationOutputs` of these names."""

    mission: str = ""
    item: int = 0
    items: int = 0
    item_name: str = ""
    mission_completed: bool = False
    mission_failed: bool = False
    item_s_m: float = 0.0
    loop_counts: tuple[int, ...] = ()
    loops: str = ""
    waits: bool = False
    trouble: str = ""


class Auto(DriveMode):
    """Drives the mission from where it was left, or stands where there is none.

    Parameters
    ----------
    mission
        The mission at the start; None: none.
    robot
        That drives it.

    Attributes
    ----------
    runs
        How often a mission was loaded, begun anew or aborted.

    Raises
    ------
    MissionError
        If the robot cannot drive the mission; one line for each item.
    """

    def __init__(self, mission: Mission | None, robot: NavigatedRobot) -> None:
        self._robot = robot
        self._runner = MissionRunner(mission, robot) if mission else None
        self._go_ahead = False
        self.runs = 0

    @property
    def mission(self) -> Mission | None:
        """The mission."""
        return None if self._runner is None else self._runner.mission

    @property
    def needs_pilot(self) -> bool:
        """The mission has items that a pilot drives, or zones that only a pilot knows."""
        return self.mission is not None and needs_pilot(self.mission)

    @property
    def is_completed(self) -> bool:
        """`begin` would start the mission over."""
        return self._runner is not None and self._runner.completed

    @property
    def goal(self) -> tuple[float, float] | None:
        """Place in `world` that it drives to now [m]; None: its item names none."""
        runner = self._runner
        return runner.goal if runner is not None and self.is_under_way else None

    @property
    def is_under_way(self) -> bool:
        """There is something left to drive that has not failed."""
        runner = self._runner
        return runner is not None and not (runner.completed or runner.failure)

    @property
    def progress(self) -> MissionProgress:
        """How far it is."""
        runner = self._runner
        if runner is None:
            return MissionProgress()
        return MissionProgress(
            runner.mission.name,
            runner.index,
            len(runner.mission.item),
            runner.item_name,
            runner.completed,
            bool(runner.failure),
            runner.item_s_m,
            runner.counts,
            runner.loops,
            runner.waits,
            runner.trouble,
        )

    def load(self, mission: Mission | None) -> None:
        """Take another mission, or none.

        Raises
        ------
        MissionError
            If the robot cannot drive it.
        """
        self._runner = None if mission is None else MissionRunner(mission, self._robot)
        self.brief_pilot()
        self.runs += 1

    def brief_pilot(self) -> None:
        """Give the robot's pilot, if there is one, the zones and the patience of the mission."""
        mission, pilot = self.mission, self._robot.pilot
        if pilot is not None:
            pilot.use_zones(() if mission is None else mission.zone)
            pilot.use_recovery(None if mission is None else mission.recovery)

    def command(self, request: GoAheadRequest | JumpRequest | AbortRequest) -> None:
        """Do what is asked of the mission.

        Raises
        ------
        MissionError, ValueError
            If it cannot be done.
        """
        if self._runner is None:
            raise MissionError("no mission is loaded")
        if isinstance(request, JumpRequest):
            self._runner.jump(request.to)
        elif isinstance(request, AbortRequest):
            self._runner.restart()
            self.runs += 1
        elif self._runner.waits:
            self._go_ahead = True
        else:
            raise MissionError("nothing waits for a go-ahead")

    def resume(self, item: int, s_m: float, counts: Sequence[int] = ()) -> None:
        """Stand where an earlier run was interrupted, as `MissionRunner.resume`."""
        if self._runner is not None:
            self._runner.resume(item, s_m, counts)

    def relocate(self) -> None:
        """Let a robot that lost and found its pose return to where its item was interrupted."""
        if self._runner is not None:
            self._runner.relocate()

    def begin(self) -> None:
        """Start, resume, retry, or repeat, as `MissionRunner.begin`."""
        if self._runner is not None:
            self.runs += self._runner.completed
            self._runner.begin()

    def pause(self) -> None:
        """Another mode steers for a while."""
        self._go_ahead = False
        if self._runner is not None:
            self._runner.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the step of the mission; stand without one."""
        if self._runner is None:
            return BehaviourOutput(0.0, 0.0)
        step = self._runner.step(situation._replace(go_ahead=self._go_ahead), now_ns)
        self._go_ahead = False
        return step


def needs_pilot(mission: Mission) -> bool:
    """Say whether a mission has items that a pilot drives, or zones that only a pilot knows."""
    return bool(mission.zone) or any(
        kind is not None and kind.piloted for kind in map(kind_of, mission.item)
    )
