"""True settings of a simulated moteus: the table `[simulation.twin.NAME]`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from firmware_sim.config.quantities import NotNegative, Positive, closed

Milliseconds: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=60_000)]


@closed
@dataclass(frozen=True, slots=True)
class MoteusSettings:
    """The table `[simulation.twin.NAME]`: configuration and undocumented properties of the drive.

    Attributes
    ----------
    firmware, register_map
        Versions that it reports.
    serial
        Its serial number: 96 bits, in words of 32, the lowest first.
    timeout_mode
        `servo.timeout_mode` in its flash.
    default_timeout_s
        `servo.default_timeout_s`.
    max_current_a, max_voltage_v, max_velocity
        Limits: `servo.max_current_A`, `servo.max_voltage`, `servo.max_velocity` [turn/s].
    fault_temperature_c
        `servo.fault_temperature`.
    acceleration_turns_s2
        `servo.default_accel_limit`.
    preparing_ms
        Time in modes 2 to 4 before it operates.
    boot_ms
        Time from power-up to the first answer.
    answers_after
        Whether an answer reports the state after the commands of its frame; else before.
    """

    firmware: int = 0x000109
    register_map: int = 5
    serial: tuple[int, int, int] = (1, 0, 0)
    timeout_mode: Literal[0, 10, 12, 15] = 12
    default_timeout_s: NotNegative = 0.1
    max_current_a: Positive = 100.0
    max_voltage_v: Positive = 46.0
    max_velocity: Positive = 500.0
    fault_temperature_c: Positive = 75.0
    acceleration_turns_s2: Positive = 1000.0
    preparing_ms: Milliseconds = 5
    boot_ms: Milliseconds = 100
    answers_after: bool = False
