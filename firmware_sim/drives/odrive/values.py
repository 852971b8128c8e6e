"""Contents of an ODrive's messages: measurements of the axis, and versions."""

from __future__ import annotations

import math
from typing import Final

from firmware_sim.drives.odrive import wire
from firmware_sim.drives.odrive.settings import ODriveSettings
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.power_stage import PowerStage

_TURN: Final = 2.0 * math.pi
_COUNTS_PER_TURN: Final = 8192
"""Resolution of the encoder: a CUI AMT102 with its default switches."""


class Values:
    """Measured values of one axis, packed for its messages.

    Parameters
    ----------
    settings
        The true drive.
    motor
        Motor of the axis.
    stage
        Power stage.
    """

    def __init__(self, settings: ODriveSettings, motor: Motor, stage: PowerStage) -> None:
        self._settings, self._motor, self._stage = settings, motor, stage

    def estimates(self) -> bytes:
        """Return position [turn] and speed [turn/s]."""
        turns = self._motor.encoder_count(_COUNTS_PER_TURN) / _COUNTS_PER_TURN
        return wire.TWO_FLOATS.pack(turns, self._motor.speed_rad_s / _TURN)

    def count(self) -> bytes:
        """Return the counts of the encoder: all, and within a turn."""
        count = self._motor.encoder_count(_COUNTS_PER_TURN)
        shadow = (count + 2**31) % 2**32 - 2**31
        return wire.TWO_INT32.pack(shadow, count % _COUNTS_PER_TURN)

    def current(self, *, is_armed: bool) -> bytes:
        """Return the motor current, commanded and measured [A]."""
        current_a = self._motor.current_a
        return wire.TWO_FLOATS.pack(current_a if is_armed else 0.0, current_a)

    def supply(self) -> bytes:
        """Return voltage [V] and current [A] of the supply."""
        return wire.TWO_FLOATS.pack(self._stage.bus_voltage_v, self._motor.axis.supply_current_a)

    def temperature(self) -> bytes:
        """Return the temperatures of bridge and motor [degC]; a motor without a sensor has none."""
        settings = self._settings
        motor_c = self._motor.axis.temperature_c if settings.motor_thermistor else math.nan
        return wire.TWO_FLOATS.pack(settings.inverter_c, motor_c)

    def version(self) -> bytes:
        """Return the versions of protocol, hardware and firmware."""
        settings = self._settings
        versions = (*settings.hardware, *settings.firmware, settings.unreleased)
        return bytes((wire.PROTOCOL_VERSION, *versions))
