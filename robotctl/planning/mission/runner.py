"""Runs the items of a mission one after the other."""

from __future__ import annotations

from robotctl.planning.behaviours.kind import NavigatedRobot
from robotctl.planning.behaviours.mission import Mission
from robotctl.planning.behaviours.registry import behaviour_for
from robotctl.planning.guard.behaviour import (
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
    failed,
)
from robotctl.planning.guard.sonars import sonar_directions
from robotctl.planning.mission.check import check_mission, item_title


class MissionRunner:
    """A mission in progress: the present item, and whether all is done or one has failed.

    Parameters
    ----------
    mission
        The behaviour.
    robot
        That does it.

    Raises
    ------
    MissionError
        If the robot cannot drive one of the items.
    """

    def __init__(self, mission: Mission, robot: NavigatedRobot) -> None:
        check_mission(mission, robot.drive, sonar_directions(robot.mounts), robot.config.guard)
        self.mission = mission
        self._behaviours = [behaviour_for(item, robot) for item in mission.item]
        self.index = 0
        self.failure = ""

    @property
    def completed(self) -> bool:
        """All items are done."""
        return self.index == len(self._behaviours)

    @property
    def item_name(self) -> str:
        """Name of the present item, or its kind where it has none; empty when completed."""
        if self.completed:
            return ""
        item = self.mission.item[self.index]
        return item.name or item.kind

    @property
    def item_s_m(self) -> float:
        """Distance along the present item [m]; 0 if it is neither path nor wall."""
        return 0.0 if self.completed else self._behaviours[self.index].s_m

    def resume(self, item: int, s_m: float) -> None:
        """Set the place where an earlier run was interrupted; `begin` continues from there.

        Parameters
        ----------
        item
            Its item, 0 to the number of items.
        s_m
            Distance along it [m].
        """
        if not 0 <= item <= len(self._behaviours):
            raise ValueError(f"item must be 0 to {len(self._behaviours)}, not {item}")
        self.index = item
        if not self.completed:
            self._behaviours[item].resume(s_m)

    def relocate(self) -> None:
        """Let a robot that lost and found its pose return to where its item was interrupted."""
        if not self.completed:
            self._behaviours[self.index].relocate()

    def begin(self) -> None:
        """Start, resume where it stopped, retry a failed item, or repeat a completed mission."""
        if self.completed:
            self._restart()
        elif self.failure:
            self.failure = ""
            self._behaviours[self.index].retry()

    def pause(self) -> None:
        """Another mode steers for a while."""
        if not self.completed:
            self._behaviours[self.index].pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the step of the present item; a new item begins in the step that ends the last."""
        while not self.completed and not self.failure:
            step = self._behaviours[self.index].step(situation, now_ns)
            title = item_title(self.mission, self.index)
            if step.status is Status.FAILED:
                self.failure = f"{title}: {step.text}"
            elif step.status is Status.RUNNING:
                text = f"{title}: {step.text}"
                return BehaviourOutput(step.v_m_s, step.omega_rad_s, step.status, text)
            else:
                self.index += 1
        if self.failure:
            return failed(self.failure)
        return done(f"mission {self.mission.name} completed")

    def _restart(self) -> None:
        """Begin with the first item."""
        self.index = 0
        self.failure = ""
        for behaviour in self._behaviours:
            behaviour.reset()
