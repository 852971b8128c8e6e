"""Links of a new keyframe with those passed last, and with old ones beside it."""

from __future__ import annotations

import math

import numpy as np

from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink, certain
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, match_pair
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.straight_walls import StraightWalls


class Linking:
    """Links new keyframes; where the poses of old ones are uncertain, searches for loops.

    Parameters
    ----------
    config, keyframes, back_end
        The map.
    loops
        Looks for loops.
    """

    def __init__(
        self,
        config: KeyframeConfig,
        keyframes: list[Keyframe],
        back_end: BackEnd,
        loops: LoopSearch,
    ) -> None:
        self._config = config
        self._keyframes = keyframes
        self._back_end = back_end
        self._loops = loops
        self._straight = StraightWalls(config, keyframes, back_end)

    def begin_odometry(self) -> None:
        """Compare no walls of stretches before and after a change of odometry."""
        self._straight.begin_odometry()

    def link_last(self, number: int, passed: list[int]) -> int:
        """Link a keyframe with the last ones that were passed, nearest last; return how many."""
        if self._config.stretch_m:
            return self._straight.link(number)
        return sum(self._link(other, number) for other in reversed(passed))

    def _link(self, first: int, second: int, sigmas: tuple[float, float] | None = None) -> bool:
        """Match two keyframes where they are and link them; return whether they match.

        With standard deviations `sigmas` [m], [rad] the link closes a loop; stretches, which have
        few echoes, must lie within three of them.
        """
        start, wide_m = self._back_end.between(first, second), 0.15
        if sigmas is not None:
            wide_m = float(np.clip(3.0 * sigmas[0], 0.15, 0.5))
        old, new = self._keyframes[first], self._keyframes[second]
        pair = match_pair(old, new, start, self._config, wide_m)
        if pair is None:
            return False
        if sigmas is not None and self._config.stretch_m:
            off = start.inverse() @ pair.pose
            turn_rad = abs(off.theta_rad)
            if math.hypot(off.x_m, off.y_m) > wide_m or turn_rad > max(3.0 * sigmas[1], 0.1):
                return False
        is_loop = sigmas is not None
        self._back_end.link(KeyframeLink(first, second, pair.pose, pair.information, is_loop))
        return True

    def link_near(self, number: int, passed: list[int], *, has_odometry: bool) -> None:
        """Link a keyframe with old ones near it; those that may be near are candidates for loops.

        Parameters
        ----------
        number
            Number of the new keyframe.
        passed
            Keyframes passed last.
        has_odometry
            Whether there is odometry.
        """
        self._loops.enter(number)
        poses, doubts = self._back_end.poses, self._back_end.doubts(number)
        is_old = np.ones(number + 1, np.bool_)
        is_old[[*passed, number]] = False
        if self._config.stretch_m:
            ways_m = np.array([each.travelled_m for each in self._keyframes])
            is_old &= ways_m < ways_m[number] - self._config.stretch_m
        away = np.hypot(*(poses[:, :2] - poses[number, :2]).T)
        sure = certain(doubts)
        near = np.flatnonzero(is_old & (away < self._config.tuning.loops.near_m) & sure)
        turn = np.abs(np.angle(np.exp(1j * (poses[near, 2] - poses[number, 2]))))
        linked, limits = 0, self._config.tuning.links
        for other in near[np.argsort(away[near] + turn)][: limits.near_tries].tolist():
            sigma_m, sigma_rad = doubts[other].tolist()
            linked += self._link(other, number, (sigma_m, sigma_rad))
            if linked == limits.near_links:
                break
        if linked:
            return
        others = np.flatnonzero(is_old & ~sure)
        self._loops.consider(number, others, doubts, has_odometry=has_odometry)
