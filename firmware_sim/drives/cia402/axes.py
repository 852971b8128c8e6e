"""Axes of a CiA 402 twin, and the objects of its dictionary that command and report them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

from firmware_sim.drives.cia402.objects import AXIS_OFFSET
from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.drives.cia402.state import STAYS, Options, PowerAxis, Ramps
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.power_stage import PowerStage
from firmware_sim.nodes.variables import AbortCode, SdoAbortError

_TURN: Final = 2.0 * math.pi


class Units(NamedTuple):
    """Units of a drive.

    Attributes
    ----------
    counts_per_turn
        Position units in one turn of the motor.
    target, actual
        Velocity units for 1 rad/s of the motor.
    """

    counts_per_turn: int
    target: float
    actual: float


class Axes:
    """Axes of a drive.

    Parameters
    ----------
    dialect
        "generic", "zlac8015d" or "roboteq".
    units
        Its true units.
    motors, ratios
        Its motors, and the motor turns per wheel turn of each, > 0.
    settings
        Other true properties.
    dictionary, indices
        Its object dictionary, and the indices of its objects.
    stage
        Its power stage.
    at_motors
        Brings the motors to the present.

    Attributes
    ----------
    axes
        The power state machine of each.
    """

    def __init__(
        self,
        dialect: str,
        units: Units,
        motors: Sequence[Motor],
        ratios: Sequence[float],
        settings: Cia402Settings,
        dictionary: ObjectDictionary,
        indices: frozenset[int],
        stage: PowerStage,
        at_motors: Callable[[], None],
    ) -> None:
        self._units, self._settings, self._stage = units, settings, stage
        self.dictionary = dictionary
        self._at_motors = at_motors
        self._is_zlac = dialect == "zlac8015d"
        self._indices = indices
        self.axes = [
            PowerAxis(
                motor,
                ratio,
                settings.current_limit_a,
                self._speed_max(),
                partial(self._options, axis),
                partial(self._ramps, axis),
            )
            for axis, (motor, ratio) in enumerate(zip(motors, ratios, strict=True))
        ]
        for axis in range(len(self.axes)):
            if self._is_zlac:
                self._connect_half(axis)
            else:
                self._connect_axis(axis)
        if self._is_zlac:
            self._connect_zlac()
        elif dialect == "roboteq":
            self._connect_roboteq()
        if 0x6079 in indices:
            dictionary.on_read(0x6079, 0, lambda: round(1000.0 * stage.bus_voltage_v))

    def _connect_axis(self, number: int) -> None:
        """Connect the standard objects of an axis."""
        offset, axis, dictionary = AXIS_OFFSET * number, self.axes[number], self.dictionary
        read, write = dictionary.on_read, dictionary.on_write
        per_rad, per_turn = self._units.actual, self._units.counts_per_turn
        rpm_per_rad = 60.0 / _TURN
        read(0x603F + offset, 0, lambda: axis.error)
        read(0x6041 + offset, 0, lambda: axis.status_word)
        read(0x6044 + offset, 0, lambda: _fit(axis.motor.speed_rad_s * rpm_per_rad, 16))
        read(0x6061 + offset, 0, lambda: dictionary.number(0x6060 + offset))
        read(0x6064 + offset, 0, lambda: _wrap(axis.motor.encoder_count(per_turn), 32))
        read(0x606C + offset, 0, lambda: _fit(axis.motor.speed_rad_s * per_rad, 32))
        rated_a = self._settings.rated_current_a
        read(0x6078 + offset, 0, lambda: _fit(1000.0 * axis.motor.current_a / rated_a, 16))
        write(0x6040 + offset, 0, lambda word: self._control([axis], word))

        def turn(index: int, unit: float) -> None:
            def target(value: int) -> None:
                is_mode = dictionary.number(0x6060 + offset) == (2 if index == 0x6042 else 3)
                if is_mode:
                    axis.target_rad_s = value / unit
                    self._at_motors()
                    axis.drive()

            write(index + offset, 0, target)

        turn(0x60FF, self._units.target)
        turn(0x6042, rpm_per_rad)
        for index in (0x605A, 0x605E):
            write(index + offset, 0, self._check_option)

    def _check_option(self, value: int) -> None:
        if value not in self._settings.stop_options:
            raise SdoAbortError(AbortCode.RANGE)

    def _connect_half(self, number: int) -> None:
        """Connect the objects of one wheel of a ZLAC8015D."""
        axis, sub, read = self.axes[number], number + 1, self.dictionary.on_read
        per_turn = self._units.counts_per_turn
        read(0x6064, sub, lambda: _wrap(axis.motor.encoder_count(per_turn), 32))
        read(0x606C, sub, lambda: _fit(axis.motor.speed_rad_s * self._units.actual, 32))
        read(0x6077, sub, lambda: _fit(10.0 * axis.motor.current_a, 16))
        read(0x2032, sub, lambda: max(0, round(10.0 * axis.motor.axis.temperature_c)))
        self.dictionary.on_write(0x60FF, sub, lambda value: self._turn(axis, value))

    def _connect_zlac(self) -> None:
        """Connect the objects that both wheels of a ZLAC8015D share: left is the low half."""
        read, write, axes = self.dictionary.on_read, self.dictionary.on_write, self.axes
        read(0x603F, 0, lambda: _halves([axis.error for axis in axes]))
        read(0x6041, 0, lambda: _halves([axis.status_word for axis in axes]))
        read(0x6061, 0, lambda: self.dictionary.number(0x6060))
        read(0x6077, 3, lambda: _halves([_fit(10.0 * a.motor.current_a, 16) for a in axes]))
        read(0x2035, 0, lambda: round(100.0 * self._stage.bus_voltage_v))
        write(0x6040, 0, lambda word: self._control(axes, word))

        def both(value: int) -> None:
            for axis, half in zip(axes, (value & 0xFFFF, value >> 16), strict=False):
                self._turn(axis, _wrap(half, 16))

        write(0x60FF, 3, both)

    def _connect_roboteq(self) -> None:
        read, axes = self.dictionary.on_read, self.axes
        for number, axis in enumerate(axes):
            read(0x2100, number + 1, partial(_current, axis.motor, 0.1))
        read(0x210D, 2, lambda: round(10.0 * self._stage.bus_voltage_v))
        read(0x210F, 2, lambda: _fit(axes[0].motor.axis.temperature_c, 8))
        read(0x2112, 0, lambda: max(axis.error for axis in axes))

    def _turn(self, axis: PowerAxis, value: int) -> None:
        if self.dictionary.number(0x6060) == 3:
            axis.target_rad_s = value / self._units.target
            self._at_motors()
            axis.drive()

    def _control(self, axes: Sequence[PowerAxis], word: int) -> None:
        self._at_motors()
        for axis in axes:
            axis.control(word)

    def _options(self, axis: int) -> Options:
        """Return the stop options; a drive without one of them keeps its maker's default."""
        number, offset = self.dictionary.number, 0 if self._is_zlac else AXIS_OFFSET * axis
        default = Options(quick_stop=self._settings.quick_stop, fault=self._settings.fault_stop)
        found = {
            index: number(index + offset) if index + offset in self._indices else fallback
            for index, fallback in (
                (0x605A, default.quick_stop),
                (0x605B, default.shutdown),
                (0x605C, default.disable),
                (0x605D, default.halt),
                (0x605E, default.fault),
            )
        }
        fault = min(found[0x605E], STAYS)
        return Options(found[0x605A], found[0x605B], found[0x605C], found[0x605D], fault)

    def _ramps(self, axis: int, target_rad_s: float) -> Ramps:
        """Return the ramps of an axis for a target speed [rad/s^2]."""
        number = self.dictionary.number
        if self._is_zlac:
            change = abs(target_rad_s - self.axes[axis].motor.speed_rad_s)
            span = self._speed_max() if self._settings.ramps_are_full_scale else max(change, 0.1)
            times_ms = [max(1, number(index, axis + 1)) for index in (0x6083, 0x6084, 0x6085)]
            return Ramps(*(span * 1000.0 / time_ms for time_ms in times_ms))
        offset = AXIS_OFFSET * axis
        if number(0x6060 + offset) == 2:
            rates = [
                number(index + offset, 1) / max(1, number(index + offset, 2)) * _TURN / 60.0
                for index in (0x6048, 0x6049, 0x604A)
            ]
        else:
            rates = [number(i + offset) / self._units.target for i in (0x6083, 0x6084, 0x6085)]
        return Ramps(*(max(rate, 0.1) for rate in rates))

    def _speed_max(self) -> float:
        top = self._settings.speed_max_rad_s
        return min(top, 1000.0 / self._units.target) if self._is_zlac else top


def _current(motor: Motor, unit_a: float) -> int:
    """Return the current of a motor in a unit [A]."""
    return _fit(motor.current_a / unit_a, 16)


def _fit(value: float, bits: int) -> int:
    """Return the nearest integer in the range of a signed object of `bits` bits."""
    top = (1 << bits - 1) - 1
    return round(min(max(value, -top), top))


def _wrap(value: int, bits: int) -> int:
    """Return a counter wrapped to a signed object of `bits` bits."""
    half = 1 << bits - 1
    return (value + half) % (1 << bits) - half


def _halves(values: Sequence[int]) -> int:
    """Return two 16-bit values packed into 32 bits, the first low."""
    low, high = (*values, 0)[:2]
    return low & 0xFFFF | (high & 0xFFFF) << 16
