"""Runs the items of a mission one after the other."""

from __future__ import annotations

from collections.abc import Sequence

from robotctl.planning.behave.behaviours.behaviour import (
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.flow import Target
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.registry import behaviour_for
from robotctl.planning.behave.behaviours.rejoin import Rejoining
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.behaviours.wait_for import WaitForItem
from robotctl.planning.behave.mission.check import check_mission, item_title
from robotctl.planning.behave.mission.flow import MissionFlow, item_index
from robotctl.planning.behave.mission.mission_file import Mission


class MissionRunner:
    """A mission in progress: the present item, and whether all is done or one has failed.

    Parameters
    ----------
    mission
        The behaviour.
    robot
        That does it.

    Attributes
    ----------
    index
        The present item, from 0; the number of items once all are done.
    failure
        Why the present item has failed; empty: it has not.
    trouble
        The last failure of any item since the mission began; empty: there was none.

    Raises
    ------
    MissionError
        If the robot cannot drive one of the items.
    """

    def __init__(self, mission: Mission, robot: NavigatedRobot) -> None:
        check_mission(mission, robot.abilities)
        self.mission = mission
        self._flow = MissionFlow(mission.item)
        self._behaviours = {
            index: behaviour_for(item, robot)
            for index, item in enumerate(mission.item)
            if not self._flow.leads(index)
        }
        self.index = 0
        self.failure = ""
        self.trouble = ""
        self._asks = False

    @property
    def completed(self) -> bool:
        """All items are done."""
        return self.index == len(self.mission.item)

    @property
    def item_name(self) -> str:
        """Name of the present item, or its kind where it has none; empty when completed."""
        if self.completed:
            return ""
        item = self.mission.item[self.index]
        return item.name or item.kind

    @property
    def goal(self) -> tuple[float, float] | None:
        """Place in `world` that the present item leads to [m]; None: it names none."""
        item = None if self.completed else self.mission.item[self.index]
        if isinstance(item, GotoItem | StraightToItem):
            return item.x_m, item.y_m
        return item.waypoints[-1] if isinstance(item, DriveItem) else None

    @property
    def item_s_m(self) -> float:
        """Distance along the present item [m]; 0 if it is neither path nor wall."""
        return 0.0 if self._present is None else self._present.s_m

    @property
    def counts(self) -> tuple[int, ...]:
        """How often each repeat and jump was taken, in the order of the items."""
        return self._flow.counts

    @property
    def loops(self) -> str:
        """How far the repeats and jumps are that were begun, as text."""
        told = [
            (item_title(self.mission, index), self._flow.told(index))
            for index in range(len(self.mission.item))
            if self._flow.leads(index)
        ]
        return ", ".join(f"{title}: {count}" for title, count in told if count)

    @property
    def waits(self) -> bool:
        """The present item waits for an operator's go-ahead, or asks for it."""
        item = None if self.completed else self.mission.item[self.index]
        waits = self._asks or (isinstance(item, WaitForItem) and item.go_ahead)
        return waits and not self.failure

    @property
    def _present(self) -> Rejoining | None:
        """The present item's behaviour; None: there is none."""
        return self._behaviours.get(self.index)

    def resume(self, item: int, s_m: float, counts: Sequence[int] = ()) -> None:
        """Set the place where an earlier run was interrupted; `begin` continues from there.

        Parameters
        ----------
        item
            Its item, 0 to the number of items.
        s_m
            Distance along it [m].
        counts
            As `counts` was then.
        """
        if not 0 <= item <= len(self.mission.item):
            raise ValueError(f"item must be 0 to {len(self.mission.item)}, not {item}")
        self._flow.resume(counts)
        self.index = item
        if self._present is not None:
            self._present.resume(s_m)

    def relocate(self) -> None:
        """Let a robot that lost and found its pose return to where its item was interrupted."""
        if self._present is not None:
            self._present.relocate()

    def begin(self) -> None:
        """Start, resume where it stopped, retry a failed item, or repeat a completed mission."""
        if self.completed:
            self.restart()
        elif self.failure:
            self.failure = ""
            if self._present is not None:
                self._present.retry()

    def restart(self) -> None:
        """Stand at the first item, with nothing counted."""
        self._flow.reset()
        self.trouble = ""
        self._enter(0)

    def jump(self, to: Target) -> None:
        """Stand at the beginning of another item; what was counted stays.

        Raises
        ------
        ValueError
            If there is no such item.
        """
        self._enter(item_index(self.mission.item, to))

    def pause(self) -> None:
        """Another mode steers for a while: what was asked is answered by that."""
        self._asks = False
        if self._present is not None:
            self._present.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the step of the present item; a new item begins in the step that ends the last."""
        followed = set[int]()
        while not self.completed and not self.failure:
            title = item_title(self.mission, self.index)
            behaviour = self._present
            if behaviour is None:
                if self.index in followed:  # items that are done at once lead in a circle
                    return BehaviourOutput(0.0, 0.0, text=title)
                followed.add(self.index)
                self._enter(self._flow.follow(self.index))
                continue
            step = behaviour.step(situation, now_ns)
            self._asks = step.asks
            if step.status is Status.FAILED:
                self.failure = self.trouble = f"{title}: {step.text}"
            elif step.status is Status.RUNNING:
                return step._replace(task=title)
            else:
                self._enter(self.index + 1)
        if self.failure:
            return failed(self.failure)
        return done(f"mission {self.mission.name} completed")

    def _enter(self, index: int) -> None:
        """Begin another item from its start: it may have been done before."""
        self.index, self.failure, self._asks = index, "", False
        if self._present is not None:
            self._present.reset()
