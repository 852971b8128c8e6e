"""Fault layer between the true inertial sensors and the IMU's firmware."""

from __future__ import annotations

import math
from functools import partial
from typing import Final

from firmware_sim.faults.parameters import Undo
from firmware_sim.nodes.imu import ImuSample
from firmware_sim.nodes.node import NEVER_NS
from firmware_sim.sensors.imu import BodyMotion, Imu, Tilt

CARRYING_NS: Final = 1_600_000_000
"""Time to carry the robot to another place [ns]: half of it up, half down."""
LIFT_M_S2: Final = 4.0
"""Acceleration of the lift, and of its braking [m/s^2]."""


class _Tilting:
    """A tilt that grows within a time, and later declines within the same time."""

    def __init__(self, roll_rad: float, pitch_rad: float, within_ns: int, begin_ns: int) -> None:
        self._roll_rad, self._pitch_rad = roll_rad, pitch_rad
        self._within_ns, self._begin_ns = within_ns, begin_ns
        self._end_ns = NEVER_NS

    def end(self, now_ns: int) -> None:
        """Start the decline."""
        self._end_ns = now_ns

    def at(self, now_ns: int) -> Tilt:
        """Return the tilt at a time [ns]."""
        share = min((now_ns - self._begin_ns) / self._within_ns, 1.0)
        share *= 1.0 - min(max(now_ns - self._end_ns, 0) / self._within_ns, 1.0)
        return Tilt(share * self._roll_rad, share * self._pitch_rad)


class FaultyImu:
    """The inertial sensors as the IMU's firmware reads them.

    Parameters
    ----------
    imu
        True sensors.
    """

    def __init__(self, imu: Imu) -> None:
        self._imu = imu
        self._stuck = 0
        self._last: ImuSample | None = None
        self._bias_rad_s = 0.0
        self._tiltings: list[_Tilting] = []
        self._carried_ns = -CARRYING_NS
        self._carried_rad_s = 0.0

    def stick(self) -> Undo:
        """Repeat the last sample."""
        self._change_stuck(1)
        return partial(self._change_stuck, -1)

    def _change_stuck(self, by: int) -> None:
        self._stuck += by

    def add_bias(self, rate_rad_s: float) -> Undo:
        """Add a bias [rad/s] to the gyro about the upright axis."""
        self._change_bias(rate_rad_s)
        return partial(self._change_bias, -rate_rad_s)

    def _change_bias(self, by_rad_s: float) -> None:
        self._bias_rad_s += by_rad_s

    def tilt(self, roll_rad: float, pitch_rad: float, within_ns: int, now_ns: int) -> _Tilting:
        """Tilt the robot within a time for its sensors only; the plant stays in the plane."""
        tilting = _Tilting(roll_rad, pitch_rad, within_ns, now_ns)
        self._tiltings.append(tilting)
        return tilting

    def carry(self, turn_rad: float, now_ns: int) -> None:
        """Measure a lift and a turn from now on, though the plant is at its new place at once.

        The robot goes up, to the other place, and down again.
        """
        self._imu.forget()
        self._carried_ns = now_ns
        self._carried_rad_s = turn_rad / (CARRYING_NS * 1e-9)

    def sample(self, now_ns: int, motion: BodyMotion) -> ImuSample:
        """Return the means since the last sample."""
        tilts = [each.at(now_ns) for each in self._tiltings]
        lift_m_s2, turn_rad_s = 0.0, self._bias_rad_s
        share = (now_ns - self._carried_ns) / CARRYING_NS
        if share < 1.0:
            way = math.copysign(1.0, 0.5 - share)
            lift_m_s2 = way * LIFT_M_S2 * math.sin(2.0 * math.tau * share)
            turn_rad_s += self._carried_rad_s
        tilt = Tilt(sum(t.roll_rad for t in tilts), sum(t.pitch_rad for t in tilts), lift_m_s2)
        sample = self._imu.sample(now_ns, motion, tilt)
        if self._stuck and self._last is not None:
            return self._last
        x, y, z = sample.rate_rad_s
        self._last = ImuSample((x, y, z + turn_rad_s), sample.force_m_s2)
        return self._last
