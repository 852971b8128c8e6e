"""The behaviour that drives back home along the breadcrumbs."""

from __future__ import annotations

import math

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behaviours.behaviours import FollowPath
from robotctl.planning.behaviours.breadcrumbs import Breadcrumbs, Leg
from robotctl.planning.guard.behaviour import BehaviourInput, BehaviourOutput, Status, done
from robotctl.planning.local.path import Path
from robotctl.planning.local.pursuit import PursuitConfig


class ReturnHome:
    """Follows the breadcrumbs back, leg by leg, and picks them up on its way.

    Interrupted, it goes on with what is left; crumbs that others drop meanwhile count. It ends
    within the crumbs' spacing of home.

    Parameters
    ----------
    crumbs
        The way from home; shortened as the robot returns.
    config, drive, speed_m_s
        As for `Pursuit`.
    """

    def __init__(
        self, crumbs: Breadcrumbs, config: PursuitConfig, drive: Drive, speed_m_s: float
    ) -> None:
        self._legs: list[Leg] = []
        self._path: Path | None = None
        self._follow: FollowPath | None = None
        self._pose: SE2 | None = None
        self._join: FollowPath | None = None
        self._crumbs = crumbs
        self._config = config
        self._drive = drive
        self._speed = speed_m_s
        self.reset()

    def reset(self) -> None:
        """Plan the way back from the present crumbs."""
        self._legs = self._crumbs.legs()
        self._begin_leg()

    def pause(self) -> None:
        """Plan anew when going on."""
        self._legs, self._path = [], None
        self._join, self._pose = None, None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at home.

        A robot that is suddenly found elsewhere drives straight to the nearest point of its way.
        """
        before, self._pose = self._pose, situation.pose
        if before is not None and self._is_off(before.x_m, before.y_m, situation.pose):
            crumb = self._crumbs.nearest(situation.pose)
            self._path = self._join = None
            if self._is_off(crumb.x_m, crumb.y_m, situation.pose):
                here = (situation.pose.x_m, situation.pose.y_m)
                path = Path((here, (crumb.x_m, crumb.y_m)))
                self._join = FollowPath(path, self._config, self._drive, self._speed)
                self._join.join()
        if self._join is not None:
            step = self._join.step(situation, now_ns)
            if step.status is not Status.DONE:
                return step
            self._join = None
        if self._path is None:
            self.reset()
        while self._path is not None and self._follow is not None:
            step = self._follow.step(situation, now_ns)
            leg = self._legs[0]
            self._crumbs.truncate(leg.last - self._path.segment_at(self._follow.s_m) + 1)
            if step.status is not Status.DONE:
                return step
            self._crumbs.truncate(leg.last - len(leg.points) + 2)
            del self._legs[0]
            self._begin_leg()
        return done("home")

    def _is_off(self, x_m: float, y_m: float, pose: SE2) -> bool:
        """Say whether a pose is farther from a point than a robot on its path can be."""
        return math.hypot(x_m - pose.x_m, y_m - pose.y_m) > self._config.off_path_max_m

    def _begin_leg(self) -> None:
        """Prepare to follow the first of the legs left."""
        self._path, self._follow = None, None
        if self._legs:
            leg = self._legs[0]
            self._path = Path(leg.points)
            self._follow = FollowPath(
                self._path, self._config, self._drive, self._speed, reverse=leg.reverse
            )
