"""Links of a new keyframe with those passed last, and with old ones beside it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink, certain
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import match_pair
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.straight_walls import StraightWalls


class Linking:
    """Links new keyframes; where the poses of old ones are uncertain, searches for loops.

    Parameters
    ----------
    growing
        The map.
    loops
        Looks for loops.
    """

    def __init__(self, growing: GrowingMap, loops: LoopSearch) -> None:
        self._config, self._keyframes, self._back_end = growing
        self._loops = loops
        self._straight = StraightWalls(growing)

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
        if not self._config.stretch_m:
            self._back_end.observe(pair.rms_m)
        elif sigmas is not None:
            off = start.inverse() @ pair.pose
            turn_rad = abs(off.theta_rad)
            if math.hypot(off.x_m, off.y_m) > wide_m or turn_rad > max(3.0 * sigmas[1], 0.1):
                return False
        is_loop = sigmas is not None
        self._back_end.link(KeyframeLink(first, second, pair.pose, pair.information, is_loop))
        return True

    def link_near(self, number: int, passed: list[int], unmeasured_m: float) -> None:
        """Link a keyframe with old ones near it; those that may be near are candidates for loops.

        Parameters
        ----------
        number
            Number of the new keyframe.
        passed
            Keyframes passed last.
        unmeasured_m
            Distance travelled so far without odometry [m].
        """
        self._loops.enter(number, unmeasured_m)
        doubts = self._back_end.doubts(number)
        is_old = self._is_old(number, passed)
        if not self._link_sure(number, is_old, doubts):
            self._loops.consider(number, np.flatnonzero(is_old & ~certain(doubts)), doubts)

    def link_again(self, number: int, passed: list[int]) -> int:
        """Link a keyframe with others near it and before, but those passed; return how many."""
        doubts = self._back_end.doubts(number)
        return self._link_sure(number, self._is_old(number, passed), doubts)

    def _is_old(self, number: int, passed: list[int]) -> NDArray[np.bool_]:
        """Return which keyframes are of the time before those passed last, (n,)."""
        is_old = np.arange(len(self._back_end.poses)) < number
        is_old[passed] = False
        if self._config.stretch_m:
            ways_m = np.array([each.travelled_m for each in self._keyframes])
            is_old &= ways_m < ways_m[number] - self._config.stretch_m
        return is_old

    def _link_sure(self, number: int, is_old: NDArray[np.bool_], doubts: Floats) -> int:
        """Link a keyframe with old ones whose poses in it are certain; return how many match."""
        poses = self._back_end.poses
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
        return linked
