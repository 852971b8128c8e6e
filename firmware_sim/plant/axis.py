"""One axis of the plant: a motor with a bridge of its own, and the wheel that it turns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from firmware_sim.config.parameters import SimulationParameters
from firmware_sim.plant.plant_state import AXIS, DT_S, places

COAST: Final = 1
SHORTED: Final = 2
CURRENT: Final = 3
SPEED: Final = 4

BRAKED_RAD_S: Final = 0.05
"""Speed of the wheel below which a braking drive reduces its current [rad/s]."""
HELD_S: Final = 0.05
"""Time in which a holding drive takes up a load [s]."""


class Mode(IntEnum):
    """Modes of a bridge, each with the value that `Axis.command` takes."""

    DUTY = 0
    """Voltage: a share of the supply in [-1, 1]."""
    COAST = COAST
    """Open: the motor turns freely."""
    SHORTED = SHORTED
    """Windings shorted: the motor brakes by its own current."""
    CURRENT = CURRENT
    """Current of the winding [A], positive for forward torque."""
    SPEED = SPEED
    """Speed of the wheel [rad/s], by a loop within the drive."""
    BRAKE_CURRENT = 5
    """Current against the motion [A] until the wheel stands."""
    HOLD = 6
    """Maximum current [A] for stopping the wheel and holding it in place."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits and gains of a drive's own loops, at the wheel.

    Attributes
    ----------
    current_a
        Maximum current of the winding, in all modes except COAST and SHORTED; that of
        `[simulation.motor]` if less.
    voltage_share
        Maximum output of the bridge with the loops, as a share of its full output.
    acceleration_rad_s2
        Acceleration of the reference of SPEED.
    kp_a_s_rad, ki_a_rad
        Gains of SPEED: current per speed error, and per angle error.
    """

    current_a: float = math.inf
    voltage_share: float = 1.0
    acceleration_rad_s2: float = math.inf
    kp_a_s_rad: float = 5.0
    ki_a_rad: float = 50.0


class BrakeResistor(NamedTuple):
    """A resistor that a drive switches onto the rail to keep it at or below `from_v` [V]."""

    ohm: float
    from_v: float


_MODE, _DUTY, _OMEGA, _ANGLE, _CURRENT, _WINDING_C = places(
    AXIS, "mode", "duty", "omega", "angle", "current", "winding_c"
)
_CURRENT_MAX, _VOLTAGE_SHARE, _BLOCKED = places(AXIS, "current_max", "voltage_share", "blocked")
_DEMAND, _RAMP, _KP, _KI, _REFERENCE, _INTEGRAL = places(
    AXIS, "demand", "ramp", "kp", "ki", "reference", "integral"
)
_SENSOR, _SENSE, _VOLTAGE, _DRAW = places(AXIS, "sensor", "sense", "voltage", "draw")


class Encoder:
    """A sound incremental encoder on the wheel's side of the gear.

    Parameters
    ----------
    numbers
        State of the axis whose angle it counts, as `AXIS` has it.
    counts_per_revolution
        Quadrature counts per turn of the wheel.
    """

    def __init__(self, numbers: memoryview[float], counts_per_revolution: float) -> None:
        self._numbers = numbers
        self._per_rad = counts_per_revolution / (2.0 * math.pi)

    @property
    def count(self) -> int:
        """Counts since power-on, unbounded."""
        return math.floor(self._numbers[_ANGLE] * self._per_rad)


class Axis:
    """A motor, its bridge and its wheel. Starts with the bridge open.

    Parameters
    ----------
    number
        Index among the axes of the robot.
    name
        Name of the wheel.
    record
        Its state, (1,) of `AXIS`.
    simulation
        Parameters of motor and bridge.

    Attributes
    ----------
    name
        Name of the wheel.
    mode, value
        Present command.
    """

    def __init__(
        self, number: int, name: str, record: np.ndarray, simulation: SimulationParameters
    ) -> None:
        bridge = simulation.bridge
        self.name = name
        self._number = number
        # Views for hot-path access, at a fifth of a record's cost.
        self._numbers: memoryview[float] = record.data.cast("B").cast("d")
        self._pwm_steps = 2**bridge.pwm_bits
        self._deadband = bridge.deadband
        self._bridge_share = bridge.voltage_share
        self._motor_a = simulation.motor.current_limit_a
        self._supply = 1.0
        self._sensor, self._sense = number, 1.0
        self._limits = Limits()
        self.mode, self.value = Mode.COAST, 0.0
        self._write()

    def command(self, mode: Mode, value: float = 0.0) -> None:
        """Command the bridge.

        A duty is rounded to the bridge's PWM steps, and has no effect within its dead-band. SPEED
        begins at the wheel's present speed.

        Raises
        ------
        ValueError
            If the value is not finite, a duty is not in [-1, 1], or a brake current is negative.
        """
        if mode is _DUTY_MODE:
            if not -1.0 <= value <= 1.0:
                raise ValueError(f"command: duty {value} not in [-1, 1]")
        elif not math.isfinite(value) or (mode in _BRAKES and value < 0.0):
            raise ValueError(f"command: {mode.name} with {value}")
        is_new, self.mode, self.value = mode is not self.mode, mode, value
        if is_new:
            self._numbers[_INTEGRAL] = 0.0
            self._numbers[_REFERENCE] = self._sense * self._numbers[_OMEGA]
        if is_new or mode is not _DUTY_MODE:
            self._write()
        else:
            self._numbers[_DUTY] = self._output(value)

    @property
    def limits(self) -> Limits:
        """Limits and gains of the drive's loops."""
        return self._limits

    @limits.setter
    def limits(self, limits: Limits) -> None:
        self._limits = limits
        self._write()

    @property
    def supply(self) -> float:
        """Voltage at the bridge as a share of the rail's; less than 1 is a fault."""
        return self._supply

    @supply.setter
    def supply(self, share: float) -> None:
        self._supply = share
        self._write()

    def feed_speed_loop(self, axis: int, factor: float) -> None:
        """Feed the speed loop with the speed of an axis, by number, times a factor: a fault.

        A factor of 0 is a dead encoder, -1 a reversed one; another axis is a swapped one.
        """
        self._sensor, self._sense = axis, factor
        self._write()

    def block(self, blocked: bool = True) -> None:
        """Block or release the wheel: a fault that stalls the motor."""
        self._numbers[_BLOCKED] = float(blocked)

    def turn(self, angle_rad: float) -> None:
        """Turn the wheel by hand to another angle; the robot does not move."""
        self._numbers[_ANGLE] += angle_rad

    def _write(self) -> None:
        """Write the present command as the compiled step reads it."""
        numbers, limits, mode, value = self._numbers, self._limits, self.mode, self.value
        numbers[_MODE] = float(min(mode, SPEED))
        numbers[_CURRENT_MAX] = min(self._motor_a, limits.current_a)
        numbers[_VOLTAGE_SHARE] = self._supply * self._bridge_share * limits.voltage_share
        if mode is _DUTY_MODE:
            numbers[_DUTY] = self._output(value)
        elif mode is Mode.CURRENT:
            numbers[_DEMAND] = value
        elif mode is Mode.SPEED:
            numbers[_DEMAND], numbers[_RAMP] = value, limits.acceleration_rad_s2 * DT_S
            numbers[_KP], numbers[_KI] = limits.kp_a_s_rad, limits.ki_a_rad
            numbers[_SENSOR], numbers[_SENSE] = self._sensor, self._sense
        elif mode in _BRAKES:
            # A loop for speed 0. Commutation shows the motion, whatever the encoder reports.
            numbers[_DEMAND], numbers[_RAMP] = 0.0, math.inf
            numbers[_CURRENT_MAX] = min(numbers[_CURRENT_MAX], value)
            numbers[_KP] = numbers[_CURRENT_MAX] / BRAKED_RAD_S
            numbers[_KI] = numbers[_KP] / HELD_S if mode is Mode.HOLD else 0.0
            numbers[_SENSOR], numbers[_SENSE] = self._number, 1.0

    def _output(self, duty: float) -> float:
        """Mean output of the bridge for a duty: rounded to PWM steps, less the dead-band."""
        duty, top = self._supply * duty, self._pwm_steps
        size = round(abs(duty) * top) / top - self._deadband
        if size <= 0.0:
            return 0.0
        return self._bridge_share * math.copysign(size / (1.0 - self._deadband), duty)

    def encoder(self, counts_per_revolution: float) -> Encoder:
        """Return an encoder on the wheel, with the drive's resolution."""
        return Encoder(self._numbers, counts_per_revolution)

    @property
    def powered(self) -> bool:
        """Whether the bridge may drive the wheel, not only brake it."""
        if self.mode is _DUTY_MODE:
            return self._numbers[_DUTY] != 0.0
        return self.mode is Mode.SPEED or (self.mode is Mode.CURRENT and self.value != 0.0)

    @property
    def angle_rad(self) -> float:
        """True angle of the wheel since power-on [rad], unbounded."""
        return self._numbers[_ANGLE]

    @property
    def speed_rad_s(self) -> float:
        """True speed of the wheel [rad/s]."""
        return self._numbers[_OMEGA]

    @property
    def current_a(self) -> float:
        """Current of the motor [A], positive with forward torque."""
        return self._numbers[_CURRENT]

    @property
    def supply_current_a(self) -> float:
        """Mean current out of the rail in the last step [A]; negative feeds back."""
        return self._numbers[_DRAW]

    @property
    def voltage_v(self) -> float:
        """Mean voltage at the bridge's output in the last step [V]."""
        return self._numbers[_VOLTAGE]

    @property
    def temperature_c(self) -> float:
        """Temperature of the winding [°C]."""
        return self._numbers[_WINDING_C]


_DUTY_MODE: Final = Mode.DUTY
"""`Mode.DUTY`; looking up an enum's member is slow."""
_BRAKES: Final = frozenset((Mode.BRAKE_CURRENT, Mode.HOLD))
