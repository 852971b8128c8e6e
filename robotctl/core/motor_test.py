"""One wheel turned alone, to see and hear that motor and encoder are as they should.

A drive that takes a duty is given a voltage, not a speed: with a reversed encoder our loop would
run away, a voltage does not. No voltage makes a motor faster than its back-EMF lets it, so a bound
of the voltage is one of the speed, whatever the encoder says. A drive with a loop of its own is
given a speed.
"""

from __future__ import annotations

import math
from typing import Final, Protocol

from robotctl.control.pwm import PwmConfig, PwmMap
from robotctl.messages.procedures import MotorTest
from robotctl.safety.command_guard import clamp

FASTEST_M_S: Final = 0.2
"""Bound of the speed at the tyre without load [m/s]."""

LONGEST_NS: Final = 5_000_000_000
"""Bound of the duration [ns]."""

LONGEST_LIFE_NS: Final = 500_000_000
"""No request counts longer than this after it was made [ns]."""

CLEAR_M: Final = 0.15
"""An obstacle that sonars see nearer than this ends the test [m]: the robot may swing round."""

CLEAR_NS: Final = 200_000_000
"""Time for which they must see it [ns]: a single echo may be another sonar's."""

_TOO_FAST_SHARE: Final = 1.5
_TOO_FAST_RAD_S: Final = 2.0
"""A wheel is too fast beyond its bound times the first, plus the second: downhill, or pushed."""


class Effort(Protocol):
    """Turns the effort of a test into what the wheel's drive takes."""

    def step(self, effort: float, supply_v: float, dt_s: float) -> float:
        """Return the command for an effort [-1, 1] at a supply [V], a period [s] after the last."""


class VoltageEffort:
    """A voltage, for drives that take a duty.

    Parameters
    ----------
    bound_v
        Largest voltage [V].
    pwm
        The bridge.
    """

    def __init__(self, bound_v: float, pwm: PwmConfig) -> None:
        self._bound_v = bound_v
        self._pwm = PwmMap(pwm)

    def step(self, effort: float, supply_v: float, dt_s: float) -> float:
        """Return the duty [-1, 1]."""
        return self._pwm.step(clamp(effort * supply_v, self._bound_v), supply_v, dt_s)


class SpeedEffort:
    """A share of the greatest speed, for drives that close their own loop.

    Parameters
    ----------
    bound_rad_s
        Largest speed [rad/s].
    """

    def __init__(self, bound_rad_s: float) -> None:
        self._bound_rad_s = bound_rad_s

    def step(self, effort: float, supply_v: float, dt_s: float) -> float:  # noqa: ARG002 - all outputs share one signature
        """Return the speed [rad/s]."""
        return effort * self._bound_rad_s


class MotorTesting:
    """A test that is under way.

    Parameters
    ----------
    request
        As it was first made; `problem` returned nothing for it.
    bound_rad_s
        Bound of the wheel's speed [rad/s], > 0.
    effort
        What turns the wheel.
    now_ns
        Time of its beginning [ns].
    """

    def __init__(self, request: MotorTest, bound_rad_s: float, effort: Effort, now_ns: int) -> None:
        self.request = request
        self.fastest_rad_s = 0.0
        """The greatest speed so far, with its sign [rad/s]."""
        self._bound_rad_s = bound_rad_s
        self._effort = effort
        self._began_ns = now_ns
        self._expires_ns = 0
        self.renew(request)

    def renew(self, request: MotorTest) -> None:
        """Go on as long as this request counts."""
        self._expires_ns = min(request.expires_ns, request.stamp_ns + LONGEST_LIFE_NS)

    def progress(self, now_ns: int) -> float:
        """Return the share that is done [0, 1]."""
        return min(1.0, (now_ns - self._began_ns) / self.request.duration_ns)

    def failure(self, speed_rad_s: float, now_ns: int) -> str:
        """Return why the test must end, by the wheel's speed [rad/s]; empty if it need not."""
        if abs(speed_rad_s) > abs(self.fastest_rad_s):
            self.fastest_rad_s = speed_rad_s
        if now_ns > self._expires_ns:
            return "who asked for it is silent"
        if abs(speed_rad_s) > _TOO_FAST_SHARE * self._bound_rad_s + _TOO_FAST_RAD_S:
            return f"the wheel turns at {speed_rad_s:.1f} rad/s, {self._bound_rad_s:.1f} allowed"
        return ""

    def step(self, supply_v: float, dt_s: float) -> float:
        """Return the command of the wheel at a supply [V], a period [s] after the last."""
        return self._effort.step(self.request.effort, supply_v, dt_s)


class MotorTestClearance:
    """Whether something is too near for a test.

    Attributes
    ----------
    obstacle
        What it is, for people; empty if there is nothing.
    """

    def __init__(self) -> None:
        self.obstacle = ""
        self._since_ns: int | None = None

    def watch(self, sonar_m: tuple[float, ...], now_ns: int) -> None:
        """Take the newest ranges of the sonars [m]; inf and nan are no obstacles."""
        nearest_m = min((each for each in sonar_m if math.isfinite(each)), default=math.inf)
        if nearest_m >= CLEAR_M:
            self.obstacle, self._since_ns = "", None
        elif self._since_ns is None:
            self._since_ns = now_ns
        elif now_ns - self._since_ns >= CLEAR_NS:
            self.obstacle = (
                f"an obstacle is at {nearest_m:.2f} m, none nearer than {CLEAR_M:g} m allowed"
            )


def problem(request: MotorTest, wheels: int, now_ns: int) -> str:
    """Say what is wrong with a request, empty if nothing is.

    Parameters
    ----------
    request
        The request.
    wheels
        How many driven wheels there are.
    now_ns
        The time [ns].
    """
    if not 0 <= request.wheel < wheels:
        return f"wheel {request.wheel} found, 0 to {wheels - 1} allowed"
    if not abs(request.effort) <= 1.0:
        return f"effort {request.effort} found, -1 to 1 allowed"
    if not 0 < request.duration_ns <= LONGEST_NS:
        return f"{request.duration_ns / 1e9:g} s found, up to {LONGEST_NS / 1e9:g} s allowed"
    if not 0 <= now_ns - request.stamp_ns <= LONGEST_LIFE_NS or now_ns > request.expires_ns:
        return "the request is too old, or of the future"
    return ""
