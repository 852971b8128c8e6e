"""The electrical guards of the motor controller: independent of NMT, SDO and commands.

Each guard processes samples of the power stage and returns the faults that have developed, as bits
of `DriveFault` in a plain integer, which is several times faster. Conditions must last for a
stated time, so that a transient does not stop the robot.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Final, NamedTuple

MILLISECOND_NS: Final = 1_000_000

OVER_CURRENT_NS: Final = 500 * MILLISECOND_NS
OVER_TEMPERATURE_NS: Final = 10 * MILLISECOND_NS
UNDER_VOLTAGE_NS: Final = 50 * MILLISECOND_NS
ENCODER_SILENT_NS: Final = 200 * MILLISECOND_NS
ENCODER_REVERSED_NS: Final = 100 * MILLISECOND_NS

TEMPERATURE_HYSTERESIS_C: Final = 10.0
VOLTAGE_HYSTERESIS_V: Final = 0.2

TURNING_RAD_S: Final = 3.0
"""Estimated wheel speed from which counts are expected [rad/s]."""
REVERSED_RAD_S: Final = 1.0
CHOPPING_SHARE: Final = 0.9
"""Share of the bridge's current limit from which the applied voltage is not known."""
COPPER_PER_K: Final = 0.0039
REFERENCE_C: Final = 25.0


class DriveFault(enum.IntFlag):
    """Faults in the bit order of MotorStatus."""

    OVER_CURRENT = 1
    OVER_TEMPERATURE = 2
    UNDER_VOLTAGE = 4
    ENCODER = 8
    COMMAND_TIMEOUT = 16
    PARAMETER = 32


NO_FAULT: Final = DriveFault(0)

_OVER_CURRENT: Final = int(DriveFault.OVER_CURRENT)
_OVER_TEMPERATURE: Final = int(DriveFault.OVER_TEMPERATURE)
_UNDER_VOLTAGE: Final = int(DriveFault.UNDER_VOLTAGE)
_ENCODER: Final = int(DriveFault.ENCODER)


@dataclass(frozen=True, slots=True)
class MotorModel:
    """The firmware's motor parameters.

    Attributes
    ----------
    resistance_ohm
        Resistance of the winding at 25 degC.
    back_emf_v_s_rad
        Back-EMF per wheel speed (at the gear's output).
    current_limit_a
        Current at which the bridge chops.
    counts_per_revolution
        Quadrature counts per turn of the wheel.
    """

    resistance_ohm: float
    back_emf_v_s_rad: float
    current_limit_a: float
    counts_per_revolution: int


class ChannelSample(NamedTuple):
    """One channel of the power stage: applied duty [-1, 1] (0 if the bridge does not drive)."""

    duty: float
    current_a: float
    temperature_c: float
    counts: int


class Limits(NamedTuple):
    """Objects 0x2003, 0x2004 and 0x2005 in SI units."""

    current_a: float
    temperature_c: float
    voltage_v: float


class _Persistence:
    """Time for which a condition has lasted [ns]; -1: it is absent."""

    __slots__ = ("_limit_ns", "_stood_ns")

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self._stood_ns = -1

    def update(self, condition: bool, elapsed_ns: int) -> bool:
        """Return whether the condition held in all samples for at least the limit."""
        if not condition:
            self._stood_ns = -1
            return False
        self._stood_ns = 0 if self._stood_ns < 0 else self._stood_ns + elapsed_ns
        return self._stood_ns >= self._limit_ns


class ChannelGuard:
    """Over-current, over-temperature and encoder of one channel.

    The encoder is checked against the speed given by the motor's back-EMF,
    (duty * bus voltage - R i) / k: missing counts while the motor turns (broken wire), and counts
    of the wrong sign (swapped lines). A stalled motor has no back-EMF, so a wall is no
    encoder fault; it becomes an over-current. Not checked while the bridge chops, when the applied
    voltage is unknown, nor below `TURNING_RAD_S`.
    """

    def __init__(self, model: MotorModel) -> None:
        self._model = model
        self._rad_per_count = 2.0 * math.pi / model.counts_per_revolution
        self.reset()

    def reset(self) -> None:
        """Reset the timers."""
        self._count: int | None = None
        self._current = _Persistence(OVER_CURRENT_NS)
        self._temperature = _Persistence(OVER_TEMPERATURE_NS)
        self._silent = _Persistence(ENCODER_SILENT_NS)
        self._reversed = _Persistence(ENCODER_REVERSED_NS)

    def update(
        self, sample: ChannelSample, bus_voltage_v: float, limits: Limits, elapsed_ns: int
    ) -> int:
        """Return the faults that have developed, `elapsed_ns` after the last sample."""
        high = self._current.update(abs(sample.current_a) > limits.current_a, elapsed_ns)
        faults = _OVER_CURRENT if high else 0
        if self._temperature.update(sample.temperature_c > limits.temperature_c, elapsed_ns):
            faults |= _OVER_TEMPERATURE
        if self._encoder_implausible(sample, bus_voltage_v, elapsed_ns):
            faults |= _ENCODER
        return faults

    def _encoder_implausible(
        self, sample: ChannelSample, bus_voltage_v: float, elapsed_ns: int
    ) -> bool:
        before, self._count = self._count, sample.counts
        if before is None or elapsed_ns <= 0:
            return False
        moved = sample.counts - before
        turning = 0.0
        if sample.duty and abs(sample.current_a) < CHOPPING_SHARE * self._model.current_limit_a:
            turning = self._electrical_speed_rad_s(sample, bus_voltage_v)
        expected = abs(turning) >= TURNING_RAD_S
        measured = moved * self._rad_per_count / (elapsed_ns * 1e-9)
        against = expected and abs(measured) > REVERSED_RAD_S and measured * turning < 0.0
        silent = self._silent.update(expected and moved == 0, elapsed_ns)
        return self._reversed.update(against, elapsed_ns) or silent

    def _electrical_speed_rad_s(self, sample: ChannelSample, bus_voltage_v: float) -> float:
        warm = 1.0 + COPPER_PER_K * (sample.temperature_c - REFERENCE_C)
        drop_v = self._model.resistance_ohm * warm * sample.current_a
        return (sample.duty * bus_voltage_v - drop_v) / self._model.back_emf_v_s_rad

    def cause_present(self, sample: ChannelSample, limits: Limits) -> int:
        """Return the faults whose cause persists, so that they cannot be cleared."""
        faults = _OVER_CURRENT if abs(sample.current_a) > limits.current_a else 0
        if sample.temperature_c > limits.temperature_c - TEMPERATURE_HYSTERESIS_C:
            faults |= _OVER_TEMPERATURE
        return faults


class SupplyGuard:
    """Under-voltage of the common supply."""

    def __init__(self) -> None:
        self._low = _Persistence(UNDER_VOLTAGE_NS)

    def reset(self) -> None:
        """Reset the timers."""
        self._low = _Persistence(UNDER_VOLTAGE_NS)

    def update(self, bus_voltage_v: float, limits: Limits, elapsed_ns: int) -> int:
        """Return the faults that have developed, `elapsed_ns` after the last sample."""
        low = self._low.update(bus_voltage_v < limits.voltage_v, elapsed_ns)
        return _UNDER_VOLTAGE if low else 0

    def cause_present(self, bus_voltage_v: float, limits: Limits) -> int:
        """Return the faults whose cause persists."""
        low = bus_voltage_v < limits.voltage_v + VOLTAGE_HYSTERESIS_V
        return _UNDER_VOLTAGE if low else 0
