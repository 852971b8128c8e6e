"""Runs the items of a mission one after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behaviours.behaviours import FollowPath, GoTo, TurnTo, Wait
from robotctl.planning.behaviours.follow_wall import FollowWall
from robotctl.planning.behaviours.guarded import Guarded
from robotctl.planning.behaviours.mission import (
    DriveItem,
    FollowWallItem,
    GoToItem,
    Item,
    Mission,
    TurnToItem,
    WaitItem,
)
from robotctl.planning.config import NavigationConfig
from robotctl.planning.guard.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
    failed,
)
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.guard.sonars import sonar_directions
from robotctl.planning.mission.check import check_mission, item_title
from robotctl.planning.mission.rejoin import Anchor, Paths, Rejoin

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
        self._config, self._drive, self._guard = config, drive, guard
        self._paths: Paths | None = None
        self._pose: SE2 | None = None
        """That of the last step."""
        self._under_way = False
        """Nothing came between the last step and the next."""
        self._relocated = False
        self._rejoin: Guarded | None = None
        """What brings a robot that was carried away back to its item."""

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
            self._relocated = s_m > 0.0  # it may have been found elsewhere meanwhile

    def learn_paths(self, paths: Paths) -> None:
        """Know the free paths through the world, which else are straight lines."""
        self._paths = paths

    def relocate(self) -> None:
        """Let a robot that has lost its place and found it come back to where its item stood."""
        self._relocated = True

    def begin(self) -> None:
        """Start, go on where it was left, go on with a failed item or repeat what is completed."""
        if self.completed:
            self._restart()
        elif self.failure:
            self.failure = ""
            self._behaviours[self.index].retry()

    def pause(self) -> None:
        """Somebody else steers for a while."""
        self._under_way = False
        if not self.completed:
            self._behaviours[self.index].pause()
        if self._rejoin is not None:
            self._rejoin, self._relocated = None, True

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the step of the present item; a new item begins in the step that ends the last.

        An item that was interrupted because the robot had lost its place goes on from where that
        is, or was found: the robot drives back to where the item stood.
        """
        if self._under_way and not self.completed and self._jumps_to(situation.pose):
            self._behaviours[self.index].pause()
            self._relocated = True
        if self._relocated and not self.completed:
            self._relocated, self._rejoin = False, self._way_back(situation.pose)
        self._pose, self._under_way = situation.pose, not self.completed
        while not self.completed and not self.failure:
            step = (self._rejoin or self._behaviours[self.index]).step(situation, now_ns)
            if self._rejoin is not None and step.status is not Status.RUNNING:
                self._relocated, self._rejoin = step.status is Status.FAILED, None
                if step.status is Status.DONE:
                    self._behaviours[self.index].join()
                    continue
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

    def _jumps_to(self, pose: SE2) -> bool:
        """Say whether the localiser found in between that the robot is elsewhere."""
        before, most_m = self._pose, self._config.pursuit.off_path_max_m
        return before is not None and (
            math.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m) > most_m
        )

    def _way_back(self, pose: SE2) -> Guarded | None:
        """Return what brings the robot to where its item stood; None where it is about there."""
        anchor = self._behaviours[self.index].anchor
        if anchor is None and self._pose is not None:
            anchor = Anchor(self._pose.x_m, self._pose.y_m)
        if anchor is None:
            return None
        off_m = math.hypot(anchor.x_m - pose.x_m, anchor.y_m - pose.y_m)
        turned = anchor.heading_rad is not None and not self._drive.steered
        if off_m <= self._config.pursuit.off_path_max_m and not turned:
            return None
        goal = (anchor.x_m, anchor.y_m)
        corners = self._paths.way((pose.x_m, pose.y_m), goal) if self._paths else []
        config, guard = self._config, self._guard
        rejoin = Rejoin(
            corners or [goal],
            anchor.heading_rad,
            config.pursuit,
            self._drive,
            config.guided_speed_m_s,
            guard,
        )
        return Guarded(rejoin, guard, config.guard)

    def _restart(self) -> None:
        """Begin with the first item."""
        self._relocated, self._rejoin = False, None
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
