"""Holds a robot back before its fence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.control.limiter import LimitsConfig, scale_to_limits
from robotctl.model.fence import Fence
from robotctl.model.fence_clearance import body_clearance
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.twist import Twist
from robotctl.safety.fence.prediction import MotionNow, longest_way, predict

MARGIN_M: Final = 0.05
"""Distance between body and fence at rest [m]: for how well wheels follow a set-point."""
_SHARES: Final = (0.8, 0.6, 0.4, 0.25, 0.15, 0.07)
"""Shares that are tried of a velocity that would lead too far."""
_TURNS: Final = (1.0, 0.3)
"""Shares that are tried of its turn alone, on the spot."""
_FARTHEST_STEP_M: Final = 0.02
"""Maximum motion of a point of the body between two predicted poses [m]."""
_LONGEST_STEP_S: Final = 0.02
_STANDS: Final = Twist(0.0, 0.0)


class Held(NamedTuple):
    """Velocity that the fence allows."""

    twist: Twist
    clearance_m: float
    """Clearance of the body now [m], negative: beyond; at most what matters for the motion."""
    limits: bool
    """Whether it is less than what was wanted."""


class FenceGuard:
    """Allows a velocity only if the robot could still stop before the fence.

    The body must stay within also if the next command is a stop, and if none comes any more and
    the command expires. So whatever is commanded, stopping at once is always possible in the next
    step. What is asked for is scaled down until that holds; a robot that can turn on the spot may
    turn where it cannot drive.

    A robot nearer than `MARGIN_M`, or beyond, since the fence or its pose has changed, may do what
    brings no part of it farther out than stopping at once would: so it can be driven back.

    Parameters
    ----------
    limits
        Of the set-point limiter.
    body
        Of the robot.
    period_s, life_s
        Of the steps that command, and after which a command expires [s].
    steered
        Whether the robot steers, so that it cannot turn on the spot.
    """

    def __init__(
        self,
        limits: LimitsConfig,
        body: Footprint,
        period_s: float,
        life_s: float,
        *,
        steered: bool,
    ) -> None:
        self._limits = limits
        self._body = body
        self._follow_s = (period_s, life_s)
        self._steered = steered
        fastest_m_s = limits.v_max_m_s + limits.vy_max_m_s + limits.omega_max_rad_s * body.reach_m
        self._dt_s = min(_LONGEST_STEP_S, _FARTHEST_STEP_M / fastest_m_s)

    def clearance(self, fence: Fence, now: MotionNow) -> float:
        """Return how far the body is from the fence now [m]; negative: beyond."""
        pose = now.pose
        poses = np.array([(pose.x_m, pose.y_m, pose.theta_rad)])
        return float(body_clearance(fence, self._body, poses)[0])

    def hold(self, fence: Fence, now: MotionNow, wanted: Twist) -> Held:
        """Return the largest part of `wanted` that keeps to the fence."""
        limits = self._limits
        wanted = scale_to_limits(wanted, limits)
        longest_m = longest_way(now, wanted, self._follow_s[-1], limits, self._body.reach_m)
        clearance_m = self.clearance(fence, now)
        if wanted == _STANDS or clearance_m >= MARGIN_M + longest_m:
            return Held(wanted, clearance_m, limits=False)
        cap_m = MARGIN_M + longest_m
        stopping_m = self._nearest(fence, [self._poses(now, _STANDS, 0.0)], cap_m)[0]
        needed_m = min(MARGIN_M, stopping_m)
        for tried in ([wanted], list(self._parts(wanted))):  # most often the first will do
            times_s = self._follow_s
            ways = [self._poses(now, each, time_s) for each in tried for time_s in times_s]
            nearest_m = self._nearest(fence, ways, cap_m).reshape(len(tried), -1).min(axis=1)
            allowed = np.flatnonzero(nearest_m >= needed_m)
            if len(allowed):
                twist = tried[allowed[0]]
                return Held(twist, clearance_m, limits=twist != wanted)
        return Held(_STANDS, clearance_m, limits=True)

    def _parts(self, wanted: Twist) -> Iterator[Twist]:
        """Yield what is tried of a velocity, the most first."""
        v, omega, vy = wanted
        yield from (Twist(share * v, share * omega, share * vy) for share in _SHARES)
        if not self._steered and (v or vy) and omega:
            yield from (Twist(0.0, share * omega) for share in _TURNS)

    def _poses(self, now: MotionNow, wanted: Twist, follow_s: float) -> NDArray[np.float64]:
        return np.array(predict(now, wanted, follow_s, self._limits, self._dt_s))

    def _nearest(
        self, fence: Fence, ways: list[NDArray[np.float64]], cap_m: float
    ) -> NDArray[np.float64]:
        """Return how near each of some ways comes to the fence, (len(ways),) [m]."""
        clearance = body_clearance(fence, self._body, np.concatenate(ways), cap_m)
        starts = np.cumsum([0, *(len(way) for way in ways[:-1])])
        nearest: NDArray[np.float64] = np.minimum.reduceat(clearance, starts)
        return nearest
