"""Commands for the motor drives and reports of them: one value for each actuator.

`robotctl/model/actuators.py` says which those are, and in which order.
"""

from __future__ import annotations

import enum
from typing import Final

import msgspec

from robotctl.messages.faults import Fault

NEVER_NS: Final = -(1 << 62)
"""Time of what has not come yet [ns]."""


class DriveState(enum.IntEnum):
    """State of a motor drive, whatever its make calls it.

    Numbers are those of MotorStatus.State in robot.dbc.
    """

    BOOT = 0
    READY = 1
    ENABLED = 2
    STOPPED = 3
    FAULT = 4
    EMERGENCY_STOP = 5


class ActuatorCommand(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """One command for all actuators, which take effect together.

    Parameters
    ----------
    enable
        Whether the drives may give power.
    brake
        Whether wheels without power are to brake, where their drives can; else they coast.
    values
        For each actuator a duty in [-1, 1], a speed [rad/s] or an angle [rad], as it takes; of no
        account unless enabled. Empty: 0 for all.
    """

    enable: bool = False
    brake: bool = False
    values: tuple[float, ...] = ()


class ActuatorFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Newest report about one actuator; None where its drive does not tell.

    Parameters
    ----------
    motion_ns
        Reception of position and speed, or of a joint's angle [ns].
    latch_us
        When the drive measured them by its own clock, rolling over at 2^20 [us]; -1: not told.
    position_ticks
        Position of a wheel, in `Actuator.ticks_per_revolution`. It may roll over at 2^16, and
        begins anew when the drive restarts.
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
        Temperature of the motor, or of the drive where that is all it tells [degC].
    supply_ns
        Reception of voltage and age of the command [ns].
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
