"""Closing speed of what a sonar sees: a person who walks towards the robot.

Each sonar's range is carried along by the robot's own motion and by the speed of what it sees, and
both are corrected by each reading: a critically damped observer of second order (Benedict, Bordner,
"Synthesis of an optimal set of radar track-while-scan smoothing equations", 1962, treats the gains
of such filters). One reading far off is left out; two that agree are something else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.guard_config import ApproachConfig

_SLANT: Final = 0.7
"""A wall may be so slanted that it comes nearer by this per way across the beam: the tangent of the
greatest incidence that gives an echo, 35 degrees."""
_BESIDE_M: Final = 0.3
"""Range within which a beam is narrower than a person, who leaves it by half a step [m]."""


class ApproachingEcho(NamedTuple):
    """Something that comes nearer to a sonar."""

    range_m: float
    """How far away it is [m]."""
    speed_m_s: float
    """Closing speed of the thing itself [m/s]; < 0: it goes away."""


STANDS: Final = ApproachingEcho(math.inf, 0.0)
"""Nothing comes nearer or goes away."""


class EchoMotion:
    """Watches the ranges of all sonars.

    Parameters
    ----------
    mounts
        The sonars, in the order of the ranges.
    config
        See there.
    """

    def __init__(
        self,
        mounts: Sequence[SonarMount],
        config: ApproachConfig = ApproachConfig(),  # noqa: B008
    ) -> None:
        self._config = config
        self._sights = [_Sight(mount, config) for mount in mounts]
        long_ago_ns = -round(1e9 * config.hidden_s)
        self._recent_movers: list[tuple[float, int]] = [(math.inf, long_ago_ns)] * len(mounts)
        """Range [m] and time [ns] at which each sonar last saw something that may move."""

    def step(
        self,
        ranges_m: Sequence[float],
        new: Sequence[bool],
        heard_ns: Sequence[int],
        twist: Twist,
    ) -> tuple[ApproachingEcho, ...]:
        """Return what moves in the beams, or is hidden between them; `STANDS`: nothing does.

        Parameters
        ----------
        ranges_m, new, heard_ns
            Of each sonar the last reading [m], whether it came since the last step, and when [ns].
        twist
            Velocity of the robot now.
        """
        now_ns = max(heard_ns, default=0)
        for sight, range_m, is_new, stamp_ns in zip(
            self._sights, ranges_m, new, heard_ns, strict=True
        ):
            if is_new and math.isfinite(range_m):
                sight.take(range_m, stamp_ns, twist)
        return tuple(sight.approach(twist, now_ns) for sight in self._sights)

    def expect(
        self,
        seen: Sequence[ApproachingEcho],
        ranges_m: Sequence[float],
        may_move: Sequence[bool],
        now_ns: int,
    ) -> tuple[ApproachingEcho, ...]:
        """Return what has to be expected to come nearer.

        Somebody who walks across the beam comes no nearer at first, and the next step may be
        towards the robot: what may move is taken to walk, also for a while after it has left the
        beam, unless it is seen to go away.

        Parameters
        ----------
        seen
            As `step` returned it.
        ranges_m, may_move
            Of each sonar the last reading [m], and whether nothing is known to stand there.
        now_ns
            Time of the step [ns].
        """
        for i, may in enumerate(may_move):
            if may:
                self._recent_movers[i] = ranges_m[i], now_ns
        expected = []
        for each, (range_m, stamp_ns) in zip(seen, self._recent_movers, strict=True):
            since_s = (now_ns - stamp_ns) * 1e-9
            away_m = max(range_m - self._config.walk_m_s * since_s, 0.0)
            walks = ApproachingEcho(away_m, self._config.walk_m_s)
            is_there = each is STANDS and since_s < _hidden_s(self._config, range_m)
            expected.append(walks if is_there else each)
        return tuple(expected)


def _hidden_s(config: ApproachConfig, range_m: float) -> float:
    """Return how long what left a beam at a range may stand beside it [s]."""
    return config.beside_s if range_m < _BESIDE_M else config.hidden_s


class _Sight:
    """Filter of one sonar's readings."""

    def __init__(self, mount: SonarMount, config: ApproachConfig) -> None:
        self._config = config
        self._x_m, self._y_m = mount.x_m, mount.y_m
        self._cos, self._sin = math.cos(mount.heading_rad), math.sin(mount.heading_rad)
        self.reset()

    def reset(self) -> None:
        """Know nothing."""
        self._count = 0
        self._range_m = self._nears_m_s = 0.0
        self._stamp_ns = 0
        self._odd: tuple[float, int] | None = None
        """A reading of something else, perhaps."""
        self._hidden = STANDS
        self._hidden_ns = 0

    def take(self, range_m: float, stamp_ns: int, twist: Twist) -> None:
        """Take an echo."""
        since_s = (stamp_ns - self._stamp_ns) * 1e-9
        if self._count == 0 or since_s > self._config.silence_s:
            self._begin(range_m, stamp_ns)
            return
        own_m_s, _ = self._own_m_s(twist)
        expected_m = self._range_m - (own_m_s + self._nears_m_s) * since_s
        off_m = expected_m - range_m
        if abs(off_m) > self._config.jump_m:
            if self._odd is not None and abs(self._odd[0] - range_m) <= self._config.jump_m:
                self._begin(*self._odd)
                self.take(range_m, stamp_ns, twist)
            else:
                self._hide(twist)
                self._odd = range_m, stamp_ns
            return
        self._odd = None
        keep = math.exp(-since_s / self._config.forgets_s)
        self._range_m = expected_m - (1.0 - keep * keep) * off_m
        self._nears_m_s += (1.0 - keep) ** 2 * off_m / since_s
        self._stamp_ns = stamp_ns
        self._count += 1

    def _own_m_s(self, twist: Twist) -> tuple[float, float]:
        """Return how fast the robot moves the sonar along its beam and across it, to the left."""
        x, y = twist.v_m_s - twist.omega_rad_s * self._y_m, twist.omega_rad_s * self._x_m
        return self._cos * x + self._sin * y, self._cos * y - self._sin * x

    def _begin(self, range_m: float, stamp_ns: int) -> None:
        """Take a reading as that of something new."""
        self._count, self._odd = 1, None
        self._range_m, self._nears_m_s, self._stamp_ns = range_m, 0.0, stamp_ns

    def _hide(self, twist: Twist) -> None:
        """Keep what came nearer and is not in the beam any more."""
        seen = self._seen(twist)
        if seen.speed_m_s > 0.0 and seen.range_m < self._config.hidden_m:
            self._hidden, self._hidden_ns = seen, self._stamp_ns

    def _seen(self, twist: Twist) -> ApproachingEcho:
        """Return what moves in the beam; `STANDS` if nothing does, or that is unknown."""
        _, across_m_s = self._own_m_s(twist)
        across_m_s += twist.omega_rad_s * self._range_m
        least_m_s = self._config.speed_min_m_s + _SLANT * abs(across_m_s)
        if self._count < self._config.readings or abs(self._nears_m_s) <= least_m_s:
            return STANDS
        return ApproachingEcho(self._range_m, self._nears_m_s)

    def approach(self, twist: Twist, now_ns: int) -> ApproachingEcho:
        """Return what moves in the beam, or has just left it and may be beside it."""
        if (now_ns - self._stamp_ns) * 1e-9 > self._config.silence_s and self._count:
            self._hide(twist)
            self._count = 0
        seen, seen_ns = self._seen(twist), self._stamp_ns
        since_s = (now_ns - self._hidden_ns) * 1e-9
        if seen is STANDS and since_s <= _hidden_s(self._config, self._hidden.range_m):
            seen, seen_ns = self._hidden, self._hidden_ns
        if seen is STANDS:
            return seen
        range_m, speed_m_s = seen
        return ApproachingEcho(max(range_m - speed_m_s * (now_ns - seen_ns) * 1e-9, 0.0), speed_m_s)
