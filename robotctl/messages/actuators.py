"""Commands for the motor drives and their reports: one value for each actuator.

`robotctl/model/actuators.py` defines the actuators and their order.
"""

from __future__ import annotations

import enum
from typing import Final

import msgspec

from robotctl.messages.faults import Fault

NEVER_NS: Final = -(1 << 62)
"""Time of an event that has not happened yet [ns]."""


class DriveState(enum.IntEnum):
    """State of a motor drive of any make.

    Numbers are those of MotorStatus.State in robot.dbc.
    """

    BOOT = 0
    READY = 1
    ENABLED = 2
    STOPPED = 3
    FAULT = 4
    EMERGENCY_STOP = 5


class ActuatorCommand(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """One command for all actuators, which takes effect on all at once.

    Parameters
    ----------
    enable
        Whether the drives may power the motors.
    brake
        Whether wheels without power brake, if their drives can; else they coast.
    values
        Duty in [-1, 1], speed [rad/s] or angle [rad] for each actuator, as its drive takes; ignored
        unless enabled. Empty: 0 for all.
    """

    enable: bool = False
    brake: bool = False
    values: tuple[float, ...] = ()


class ActuatorFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Newest report about one actuator; None for values that its drive does not report.

    Parameters
    ----------
    motion_ns
        Reception of position and speed, or of a joint's angle [ns].
    latch_us
        Time of measurement by the drive's own clock, rolling over at 2^20 [us]; -1: not reported.
    position_ticks
        Position of a wheel, in `Actuator.ticks_per_revolution`. It may roll over at 2^16, and
        restarts with the drive.
    speed_rad_s
        Speed of a wheel [rad/s].
    angle_rad
        Angle of a joint [rad].
    report_ns
        Reception of state, fault, current and temperature [ns].
    state, fault
        State of the drive, and the fault that it reports.
    current_a
        Motor current [A], positive for torque in the positive direction.
    temperature_c
        Temperature of the motor, or of the drive if it reports only that [degC].
    supply_ns
        Reception of voltage and command age [ns].
    voltage_v
        Supply of the drive [V].
    command_age_ms
        Age of the newest command that the drive accepted [ms].
    """

    motion_ns: int = NEVER_NS
    latch_us: int = -1
    position_ticks: int = 0
    speed_rad_s: float | None = None
    angle_rad: float | None = None
    report_ns: int = NEVER_NS
    state: DriveState = DriveState.BOOT
    fault: Fault | None = None
    current_a: float | None = None
    temperature_c: float | None = None
    supply_ns: int = NEVER_NS
    voltage_v: float | None = None
    command_age_ms: int | None = None
