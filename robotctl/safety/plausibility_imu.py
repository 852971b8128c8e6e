"""The IMU as a witness: a robot that tips over, is picked up, falls, or turns without its wheels.

Bumps, braking and bends do none of this for long: a bump's push up is followed by one down, and
attitude follows the accelerometer slowly.
"""

from __future__ import annotations

import math
from typing import Final

from robotctl.messages.control import ImuFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.sensors.imu import ImuConfig
from robotctl.safety.monitor import MonitorInputs

RISE_M_S: Final = 0.4
"""No wheel lifts the robot so fast, nor drops it [m/s]: a hand or a staircase does."""

SLIP_RAD: Final = 0.6
"""Tolerance between gyro and wheels within its memory [rad]."""

STUCK_READINGS: Final = 25
"""Identical readings, to the last bit, that prove a stuck sensor: half a second."""


class ImuMonitor:
    """Judges readings of the IMU.

    Parameters
    ----------
    imu
        How far the robot may be tilted.
    """

    def __init__(self, imu: ImuConfig) -> None:
        self._tilt_max_rad = math.radians(imu.tilt_max_deg)
        self._before: ImuFeedback | None = None
        self.reset()

    def reset(self) -> None:
        """Reset: the robot is armed."""
        self._same = 0

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick; return the fault, None if there is none."""
        imu, before = inputs.motion.imu, self._before
        if imu is None or imu is before:
            return None
        self._before = imu
        if before is not None and _read(imu) == _read(before):
            self._same += 1
        else:
            self._same = 0
        if self._same >= STUCK_READINGS:
            return Fault(FaultCode.IMU_STUCK, "the IMU repeats the same reading", "imu")
        return self.judge(imu)

    def judge(self, imu: ImuFeedback) -> Fault | None:
        """Return the fault in a single reading, None if there is none."""
        if imu.tilt_rad > self._tilt_max_rad:
            degrees, most = math.degrees(imu.tilt_rad), math.degrees(self._tilt_max_rad)
            text = f"the robot is tilted by {degrees:.0f} degrees, {most:g} are allowed"
            return Fault(FaultCode.ROBOT_TILTED, text)
        if abs(imu.rise_m_s) > RISE_M_S:
            way = "rises" if imu.rise_m_s > 0.0 else "falls"
            text = f"the robot {way} at {abs(imu.rise_m_s):.2f} m/s: somebody lifts or drops it"
            return Fault(FaultCode.PICKED_UP, text)
        if abs(imu.slip_rad) > SLIP_RAD:
            text = (
                f"gyro and wheels differ by {math.degrees(abs(imu.slip_rad)):.0f} degrees: the "
                "wheels slip, somebody turns the robot, or the gyro is wrong"
            )
            return Fault(FaultCode.GYRO_CONTRADICTS, text)
        return None


def _read(imu: ImuFeedback) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return what the sensors read."""
    return imu.rate_rad_s, imu.force_m_s2
