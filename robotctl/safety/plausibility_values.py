"""Values that no healthy sensor gives, before the robot is armed."""

from __future__ import annotations

import math
from typing import Final

from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.control import BatteryFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.actuators import Actuator, Takes
from robotctl.safety.duty_wheel_monitor import REST_RAD_S

TEMPERATURES_C: Final = (-30.0, 180.0)
"""Outside of this the temperature sensor is broken [degC]; its wire off reads -40."""

SUPPLY_V, SUPPLY_SHARE = 2.0, 0.2
"""Bus and battery voltage may differ by the greater of these [V, share of the battery's]."""

IDLE_CURRENT_A: Final = 1.0
"""More in a bridge that is off, of a wheel at rest, is a broken current sensor [A]."""


class SensorValues:
    """Judges values each alone, and the supplies against the battery.

    Parameters
    ----------
    actuators
        Wheels and joints.
    joint_max_rad
        Bound of each joint [rad].
    joint_tolerance_rad
        How far beyond it the sensor may read [rad].
    """

    def __init__(
        self,
        actuators: tuple[Actuator, ...],
        joint_max_rad: tuple[float, ...],
        joint_tolerance_rad: float,
    ) -> None:
        self._wheels = [
            (index, each.name)
            for index, each in enumerate(actuators)
            if each.takes is not Takes.ANGLE
        ]
        self._joints = [
            (index, actuators[index].name, most_rad + joint_tolerance_rad)
            for index, most_rad in enumerate(joint_max_rad, len(self._wheels))
        ]

    def faults(
        self,
        reports: tuple[ActuatorFeedback, ...],
        battery: BatteryFeedback,
        speeds_rad_s: tuple[float, ...],
        *,
        enabled: bool,
    ) -> tuple[Fault, ...]:
        """Return the values that no healthy sensor gives now."""
        faults = []
        for index, name in self._wheels:
            faults += _motor_faults(reports[index], name, speeds_rad_s[index], enabled=enabled)
        for supply_v in dict.fromkeys(report.voltage_v for report in reports):
            # False for nan.
            if supply_v is not None and not abs(supply_v - battery.voltage_v) <= max(
                SUPPLY_V, SUPPLY_SHARE * battery.voltage_v
            ):
                text = f"supply {supply_v:.1f} V and battery {battery.voltage_v:.1f} V contradict"
                faults.append(Fault(FaultCode.SUPPLY_WRONG, text))
        for index, name, far_rad in self._joints:
            angle_rad = reports[index].angle_rad
            if angle_rad is not None and not abs(angle_rad) <= far_rad:
                text = f"the {name} says {angle_rad:.2f} rad, beyond its linkage"
                faults.append(Fault(FaultCode.STEERING_WRONG, text))
        return tuple(faults)


def _motor_faults(
    report: ActuatorFeedback, name: str, speed_rad_s: float, *, enabled: bool
) -> list[Fault]:
    """Return the values of one motor's sensors that no healthy one gives."""
    faults = []
    temperature_c, current_a = report.temperature_c, report.current_a
    low_c, high_c = TEMPERATURES_C
    if temperature_c is not None and not low_c <= temperature_c <= high_c:
        text = f"{name} motor's temperature sensor says {temperature_c:g} degC"
        faults.append(Fault(FaultCode.TEMPERATURE_WRONG, text, name))
    if current_a is not None:
        idle = not enabled and abs(speed_rad_s) < REST_RAD_S
        if not math.isfinite(current_a) or (idle and abs(current_a) > IDLE_CURRENT_A):
            text = f"{name} motor's current sensor says {current_a:g} A, at rest"
            faults.append(Fault(FaultCode.CURRENT_WRONG, text, name))
    return faults
