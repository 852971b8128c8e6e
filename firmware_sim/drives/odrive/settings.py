"""The table `[simulation.twin.NAME]` of an ODrive's twin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from firmware_sim.config.quantities import NotNegative, Positive, Real, closed

Endpoint = Annotated[int, Field(strict=True, ge=1, le=65535)]
_Byte = Annotated[int, Field(strict=True, ge=0, le=255)]
_Period = Annotated[int, Field(strict=True, ge=0, le=10_000)]


@closed
@dataclass(frozen=True, slots=True)
class ODriveSettings:
    """The true drive: its owner's settings, and properties that its maker does not document.

    Attributes
    ----------
    firmware, hardware
        Versions; firmware 0.5 does not report the hardware's.
    unreleased
        Whether it reports its firmware as a development version.
    heartbeat_ms, encoder_ms
        Periods of the cyclic messages [ms]; 0: off.
    watchdog_ms
        Stored time of the watchdog [ms]; 0: off.
    sdo_endpoints
        Endpoints of the watchdog's time [s] and its switch, with firmware 0.6.
    watchdog_fed_by
        Messages that feed the watchdog with firmware 0.6: those with a set-point or a requested
        state, or any. With 0.5 any does.
    watchdog_while_idle
        Whether the watchdog also expires while the axis is idle, with firmware 0.6. With 0.5 it
        does.
    heartbeat_on_change
        Whether a heartbeat comes at once when state or errors change.
    pads_sdo
        Whether TxSdo has 8 bytes for a value of less than 4.
    boot_ms
        Time from power to the first message [ms].
    arming_ms
        Time from the request of closed-loop control to its start [ms].
    calibrated
        Whether motor and encoder are calibrated; else it refuses closed-loop control.
    vel_limit
        Maximum speed of the motor [turn/s].
    vel_limit_tolerance
        Multiple of `vel_limit` at which the axis disarms; 0: never.
    vel_ramp_rate
        Acceleration with input mode VEL_RAMP [turn/s^2].
    current_limit_a
        Maximum current of the motor [A].
    current_margin_a
        Current above the limit at which the axis disarms [A].
    undervoltage_v, overvoltage_v
        Supply voltages at which it disarms [V].
    brake_resistor_ohm, brake_resistor_from_v
        Brake resistor (0: none), and the supply voltage from which it conducts [V].
    motor_thermistor
        Whether the motor has a temperature sensor.
    motor_max_c
        Motor temperature at which the axis disarms [degC].
    inverter_c
        Temperature of the bridge [degC].
    """

    firmware: tuple[_Byte, _Byte, _Byte] = (0, 6, 10)
    hardware: tuple[_Byte, _Byte, _Byte] = (5, 2, 0)
    unreleased: bool = False
    heartbeat_ms: _Period = 100
    encoder_ms: _Period = 10
    watchdog_ms: NotNegative = 0.0
    sdo_endpoints: tuple[Endpoint, Endpoint] = (213, 214)
    watchdog_fed_by: Literal["set-points", "any"] = "set-points"
    watchdog_while_idle: bool = True
    heartbeat_on_change: bool = False
    pads_sdo: bool = False
    boot_ms: Positive = 500.0
    arming_ms: NotNegative = 2.0
    calibrated: bool = True
    vel_limit: Positive = 50.0
    vel_limit_tolerance: NotNegative = 1.2
    vel_ramp_rate: Positive = 10.0
    current_limit_a: Positive = 20.0
    current_margin_a: Positive = 8.0
    undervoltage_v: NotNegative = 8.0
    overvoltage_v: Positive = 56.0
    brake_resistor_ohm: NotNegative = 0.0
    brake_resistor_from_v: Positive = 50.0
    motor_thermistor: bool = False
    motor_max_c: Positive = 120.0
    inverter_c: Real = 35.0
