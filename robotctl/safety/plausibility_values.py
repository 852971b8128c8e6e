"""Values that no healthy sensor gives, before the robot is armed."""

from __future__ import annotations

import math
from typing import Final

from robotctl.messages.control import BatteryFeedback, DriveStatus, MotorStatus
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.plausibility import REST_RAD_S

TEMPERATURES_C: Final = (-30.0, 180.0)
"""Outside of this the temperature sensor is broken [degC]; its wire off reads -40."""

SUPPLY_V, SUPPLY_SHARE = 2.0, 0.2
"""Bus and battery voltage may differ by the greater of these [V, share of the battery's]."""

IDLE_CURRENT_A: Final = 1.0
"""More in a bridge that is off, of a wheel at rest, is a broken current sensor [A]."""


class SensorValues:
    """Judges values each alone, and the supply against the battery.

    Parameters
    ----------
    wheel_names
        The driven wheels.
    steering_max_rad
        Bound of the linkage [rad]; 0: no steering.
    steering_tolerance_rad
        How far beyond it the sensor may read [rad].
    """

    def __init__(
        self,
        wheel_names: tuple[str, ...],
        steering_max_rad: float,
        steering_tolerance_rad: float,
    ) -> None:
        self._wheel_names = wheel_names
        self._steers = steering_max_rad != 0.0
        self._far_rad = steering_max_rad + steering_tolerance_rad

    def faults(
        self,
        motor: MotorStatus,
        drive: DriveStatus,
        battery: BatteryFeedback,
        speeds_rad_s: tuple[float, ...],
        *,
        enabled: bool,
    ) -> tuple[Fault, ...]:
        """Return the values that no healthy sensor gives now."""
        faults = []
        for index, name in enumerate(self._wheel_names):
            current_a = (motor.current1_a, motor.current2_a)[index]
            temperature_c = (motor.temperature1_c, motor.temperature2_c)[index]
            if not TEMPERATURES_C[0] <= temperature_c <= TEMPERATURES_C[1]:
                text = f"{name} motor's temperature sensor says {temperature_c:g} degC"
                faults.append(Fault(FaultCode.TEMPERATURE_WRONG, text, name))
            idle = not enabled and abs(speeds_rad_s[index]) < REST_RAD_S
            if not math.isfinite(current_a) or (idle and abs(current_a) > IDLE_CURRENT_A):
                text = f"{name} motor's current sensor says {current_a:g} A, at rest"
                faults.append(Fault(FaultCode.CURRENT_WRONG, text, name))
        supply_v, battery_v = drive.bus_voltage_v, battery.voltage_v
        # False for nan.
        if not abs(supply_v - battery_v) <= max(SUPPLY_V, SUPPLY_SHARE * battery_v):
            text = f"supply {supply_v:.1f} V and battery {battery_v:.1f} V contradict"
            faults.append(Fault(FaultCode.SUPPLY_WRONG, text))
        if self._steers and not abs(drive.steering_rad) <= self._far_rad:
            text = f"the steering says {drive.steering_rad:.2f} rad, beyond its linkage"
            faults.append(Fault(FaultCode.STEERING_WRONG, text))
        return tuple(faults)
