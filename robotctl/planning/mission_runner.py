"""Runs the items of a mission one after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robotctl.model.drives import Drive
from robotctl.model.sonar import SonarMount
from robotctl.planning.behaviours import FollowPath, GoTo, TurnTo, Wait
from robotctl.planning.config import NavigationConfig
from robotctl.planning.follow_wall import FollowWall
from robotctl.planning.guarded import Guarded
from robotctl.planning.mission import (
    DriveItem,
    FollowWallItem,
    GoToItem,
    Item,
    Mission,
    TurnToItem,
    WaitItem,
)
from robotctl.planning.mission_check import check_mission, item_title
from robotctl.planning.obstacle_guard import ObstacleGuard
from robotctl.planning.situation import Behaviour, Situation, Status, Step, done, failed
from robotctl.planning.sonars import sonar_directions

_SPARE_S = 20.0
"""Default time-outs are three times the way at full speed, and this [s]."""
_NO_LENGTH_S = 60.0


class MissionRunner:
    """A mission in progress: the present item, and whether all is done or one has failed.

    Parameters
    ----------
    mission
        What to do.
    config, drive, mounts, guard
        Of the robot.

    Raises
    ------
    MissionError
        If the robot cannot drive one of the items.
    """

    def __init__(
        self,
        mission: Mission,
        config: NavigationConfig,
        drive: Drive,
        mounts: Sequence[SonarMount],
        guard: ObstacleGuard,
    ) -> None:
        check_mission(mission, drive, sonar_directions(mounts), config.guard)
        self.mission = mission
        self._behaviours = [
            Guarded(
                _behaviour(item, config, drive, mounts, guard), guard, config.guard, _time_out(item)
            )
            for item in mission.item
        ]
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
        """The way along the present item [m]; 0 where it is neither path nor wall."""
        return 0.0 if self.completed else self._behaviours[self.index].s_m

    def resume(self, item: int, s_m: float) -> None:
        """Stand where an earlier run was interrupted, for `begin` to go on from there.

        Parameters
        ----------
        item
            Its item, 0 to the number of items.
        s_m
            The way along it [m].
        """
        if not 0 <= item <= len(self._behaviours):
            raise ValueError(f"item must be 0 to {len(self._behaviours)}, not {item}")
        self.index = item
        if not self.completed:
            self._behaviours[item].resume(s_m)

    def begin(self) -> None:
        """Start, go on where it was left, go on with a failed item or repeat what is completed."""
        if self.completed:
            self._restart()
        elif self.failure:
            self.failure = ""
            self._behaviours[self.index].retry()

    def pause(self) -> None:
        """Somebody else steers for a while."""
        if not self.completed:
            self._behaviours[self.index].pause()

    def step(self, situation: Situation, now_ns: int) -> Step:
        """Return the step of the present item; a new item begins in the step that ends the last."""
        while not self.completed and not self.failure:
            step = self._behaviours[self.index].step(situation, now_ns)
            title = item_title(self.mission, self.index)
            if step.status is Status.FAILED:
                self.failure = f"{title}: {step.text}"
            elif step.status is Status.RUNNING:
                text = f"{title}: {step.text}"
                return Step(step.v_m_s, step.omega_rad_s, step.status, text)
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


def _behaviour(
    item: Item,
    config: NavigationConfig,
    drive: Drive,
    mounts: Sequence[SonarMount],
    guard: ObstacleGuard,
) -> Behaviour:
    """Return the behaviour of an item."""
    match item:
        case DriveItem():
            return FollowPath(item.path(), config.pursuit, drive, item.speed_m_s)
        case FollowWallItem():
            return FollowWall(item, config.wall, mounts, config.pursuit.off_path_max_m)
        case GoToItem():
            return GoTo(item.x_m, item.y_m, config.pursuit, drive, item.speed_m_s, guard)
        case TurnToItem():
            return TurnTo(math.radians(item.heading_deg), config.pursuit)
        case WaitItem():
            return Wait(item.duration_s)


def _time_out(item: Item) -> float | None:
    """Return the time after which an item fails [s]."""
    if isinstance(item, WaitItem):
        return None
    if item.time_out_s is not None:
        return item.time_out_s
    if isinstance(item, DriveItem):
        return 3.0 * item.path().length_m / item.speed_m_s + _SPARE_S
    if isinstance(item, FollowWallItem) and item.until.length_m is not None:
        return 3.0 * item.until.length_m / item.speed_m_s + _SPARE_S
    return _NO_LENGTH_S
