"""True settings of a simulated VESC: the table `[simulation.twin.NAME]`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from pydantic import Field

from firmware_sim.config.quantities import NotNegative, Positive, closed

Milliseconds: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=60_000)]


@closed
@dataclass(frozen=True, slots=True)
class VescSettings:
    """The table `[simulation.twin.NAME]`: the drive as it left VESC Tool.

    Attributes
    ----------
    firmware
        Major and minor version.
    stored_timeout_ms, stored_brake_current_a
        Stored settings for a silent host.
    status
        Numbers of the status frames that it sends.
    min_erpm
        Speed below which the speed loop releases the motor.
    max_erpm, ramp_erpm_s
        Limits of the speed loop.
    current_a, absolute_current_a
        Limit of the motor current, and current of the fault.
    fault_stop_ms
        Duration of a fault.
    boot_ms
        Time from power-up to the first frame.
    notifies_boot
        Whether it sends NOTIFY_BOOT.
    sets_timeout
        Whether it knows COMM_SET_APPCONF_NO_STORE.
    tells_flags
        Whether it reports time-out and kill switch in COMM_GET_VALUES_SELECTIVE.
    servo_output
        Whether the servo output is enabled.
    """

    firmware: tuple[int, int] = (6, 5)
    stored_timeout_ms: Milliseconds = 1000
    stored_brake_current_a: NotNegative = 0.0
    status: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    min_erpm: NotNegative = 0.0
    max_erpm: Positive = 100_000.0
    ramp_erpm_s: Positive = 25_000.0
    current_a: Positive = 60.0
    absolute_current_a: Positive = 150.0
    fault_stop_ms: Milliseconds = 500
    boot_ms: Milliseconds = 150
    notifies_boot: bool = True
    sets_timeout: bool = True
    tells_flags: bool = True
    servo_output: bool = True
