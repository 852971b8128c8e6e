"""Fault layer between the true robot and its firmware.

The true robot obeys physics while the firmware sees the fault. A part without a fault passes
everything through unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from firmware_sim.config.parameters import SonarMount
from firmware_sim.errors import SimulationError
from firmware_sim.faults.parameters import Undo
from firmware_sim.nodes.sonar import GROUP_SIZE, Ranges

if TYPE_CHECKING:
    from firmware_sim.plant.axis import Axis, BrakeResistor, Limits, Mode
    from firmware_sim.plant.plant import Plant
    from firmware_sim.sensors.sonar import SonarRing

SOUND: Final = 1
STUCK: Final = 0
REVERSED: Final = -1

RESET_V: Final = 6.0
"""Supply below which the drive's processor is held in reset [V]."""
RELEASE_V: Final = 6.5
"""Supply above which the drive's processor starts again [V]."""


class BrokenEncoder:
    """One fault of an encoder: a factor on its counts while no later fault is present."""

    def __init__(self, encoder: FaultyEncoder, factor: int, frozen_rad_s: float | None) -> None:
        self._encoder = encoder
        self.factor = factor
        self.frozen_rad_s = frozen_rad_s
        """Constant reported speed of a fault that deceives only the host [rad/s]."""

    @property
    def counts(self) -> bool:
        """Whether this is the fault in effect."""
        return self._encoder.shows(self)

    def end(self) -> None:
        """End the fault."""
        self._encoder.end(self)


class FaultyEncoder:
    """Encoder of a wheel: its counts are continuous across changes of its faults.

    Parameters
    ----------
    wheel
        Number of the wheel.
    axis
        The true axis.
    on_change
        Called after a fault has begun or ended.
    """

    def __init__(self, wheel: int, axis: Axis, on_change: Callable[[], None]) -> None:
        self.wheel = wheel
        self._axis = axis
        self._counts_per_turn = 1.0
        self._sound = axis.encoder(1)
        self._on_change = on_change
        self._present: list[BrokenEncoder] = []
        self._read = self._true = 0

    def resolve(self, counts_per_revolution: float) -> None:
        """Set the counts per turn of the wheel from now on."""
        self._read = self.count
        self._counts_per_turn = counts_per_revolution
        self._sound = self._axis.encoder(counts_per_revolution)
        self._true = self._sound.count

    @property
    def count(self) -> int:
        """Quadrature counts since power-on."""
        factor = self._present[-1].factor if self._present else SOUND
        return self._read + factor * (self._sound.count - self._true)

    @property
    def speed_rad_s(self) -> float:
        """Speed derived from the counts [rad/s]."""
        fault = self._present[-1] if self._present else None
        if fault is not None and fault.frozen_rad_s is not None:
            return fault.frozen_rad_s
        return (SOUND if fault is None else fault.factor) * self._axis.speed_rad_s

    @property
    def loop_factor(self) -> int:
        """Factor on the speed that a drive's own loop measures."""
        factors = [each.factor for each in self._present if each.frozen_rad_s is None]
        return factors[-1] if factors else SOUND

    def begin(self, factor: int) -> BrokenEncoder:
        """Count by a factor from now on."""
        return self._begin(factor, None)

    def freeze(self) -> BrokenEncoder:
        """Report the present counts and speed from now on; a loop in the drive is not deceived."""
        return self._begin(STUCK, self.speed_rad_s)

    def _begin(self, factor: int, frozen_rad_s: float | None) -> BrokenEncoder:
        self._anchor()
        fault = BrokenEncoder(self, factor, frozen_rad_s)
        self._present.append(fault)
        self._on_change()
        return fault

    def end(self, fault: BrokenEncoder) -> None:
        """End one fault."""
        self._anchor()
        self._present.remove(fault)
        self._on_change()

    def shows(self, fault: BrokenEncoder) -> bool:
        """Whether a fault is the latest, which is in effect."""
        return bool(self._present) and self._present[-1] is fault

    def jump(self, turns: float) -> None:
        """Let the count jump once by a number of wheel turns."""
        self._read += round(turns * self._counts_per_turn)

    def _anchor(self) -> None:
        self._read, self._true = self.count, self._sound.count


class Socket:
    """Counter of an axis, continuous across changes of the encoder that is plugged in."""

    def __init__(self, encoder: FaultyEncoder) -> None:
        self.encoder = encoder
        self._offset = 0

    @property
    def count(self) -> int:
        """Count of the drive."""
        return self.encoder.count + self._offset

    def plug(self, encoder: FaultyEncoder) -> None:
        """Plug an encoder in."""
        before = self.count
        self.encoder = encoder
        self._offset = before - encoder.count


class FaultyAxis:
    """One axis as the firmware of its drive sees it.

    Parameters
    ----------
    axis
        True axis.
    stage
        Its stage.
    encoder
        Encoder of its wheel.

    Attributes
    ----------
    true
        True axis.
    own_encoder
        Encoder of its wheel, wherever it is plugged in.
    socket
        Counter of the axis, whichever encoder is plugged in.
    """

    def __init__(self, axis: Axis, stage: FaultyStage, encoder: FaultyEncoder) -> None:
        self.true = axis
        self._stage = stage
        self.own_encoder = encoder
        self.socket = Socket(encoder)
        self._blocks = 0
        self._grips: list[float] = []
        self._added_a = self._added_c = 0.0

    # Faults -------------------------------------------------------------------------------------

    def block(self) -> Undo:
        """Hold the wheel, whose motor stalls."""
        self._change_blocks(1)
        return lambda: self._change_blocks(-1)

    def _change_blocks(self, by: int) -> None:
        self._blocks += by
        self.true.block(self._blocks > 0)

    def loosen(self, grip: float) -> Undo:
        """Reduce the wheel's grip on the floor to a share; the least of several counts."""
        self._grips.append(grip)
        self._hold_floor()

        def end() -> None:
            self._grips.remove(grip)
            self._hold_floor()

        return end

    def _hold_floor(self) -> None:
        self._stage.plant.loosen(self.own_encoder.wheel, min(self._grips, default=1.0))

    def add_current(self, current_a: float) -> Undo:
        """Increase the motor current [A] in its present direction.

        The direction at zero current is that of its duty, and forward at zero duty.
        """
        self._added_a += current_a

        def end() -> None:
            self._added_a -= current_a

        return end

    def add_heat(self, rise_k: float) -> Undo:
        """Heat the winding [K]."""
        self._added_c += rise_k

        def end() -> None:
            self._added_c -= rise_k

        return end

    # What the firmware sees and does ------------------------------------------------------------

    @property
    def limits(self) -> Limits:
        """Limits and gains of the drive's loops."""
        return self.true.limits

    @limits.setter
    def limits(self, limits: Limits) -> None:
        self.true.limits = limits

    def command(self, mode: Mode, value: float = 0.0) -> None:
        """Pass a command on; a sagging supply reduces the bridge's output."""
        if self._stage.is_low:
            self.true.supply = self._stage.share
        self.true.command(mode, value)

    def encoder(self, counts_per_revolution: float) -> Socket:
        """Return the counter of the axis, for an encoder with this resolution."""
        self.own_encoder.resolve(counts_per_revolution)
        return self.socket

    @property
    def speed_rad_s(self) -> float:
        """Speed measured by the encoder that is plugged in [rad/s]."""
        return self.socket.encoder.speed_rad_s

    @property
    def current_a(self) -> float:
        """Current of the motor [A]."""
        current_a, added_a = self.true.current_a, self._added_a
        if not added_a:
            return current_a
        return current_a + math.copysign(added_a, current_a or self.true.value or 1.0)

    @property
    def supply_current_a(self) -> float:
        """Current out of the supply [A]; negative feeds back."""
        return self.true.supply_current_a

    @property
    def voltage_v(self) -> float:
        """Mean voltage at the motor [V]."""
        return self.true.voltage_v

    @property
    def temperature_c(self) -> float:
        """Winding temperature [degC]."""
        return self.true.temperature_c + self._added_c


class FaultyStage:
    """The power stage as seen by the firmware of the drives.

    Parameters
    ----------
    plant
        True robot.

    Attributes
    ----------
    plant
        True robot.
    axes
        Axes, in the order of the plant's.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        encoders = [FaultyEncoder(*each, self._connect) for each in enumerate(plant.axes)]
        self.axes = tuple(
            FaultyAxis(axis, self, encoder)
            for axis, encoder in zip(plant.axes, encoders, strict=True)
        )
        self._swaps: list[tuple[int, int]] = []
        self._lost_v = 0.0
        self._ceilings_v: dict[object, float] = {}
        self._in_reset = False
        self.is_low = False
        """Whether a fault lowers the supply."""

    # Faults -------------------------------------------------------------------------------------

    def swap(self, one: int, other: int) -> Undo:
        """Plug the cables of the encoders of two wheels into each other's sockets."""
        pair = min(one, other), max(one, other)
        self._swaps.append(pair)
        self._plug()

        def end() -> None:
            self._swaps.remove(pair)
            self._plug()

        return end

    def _plug(self) -> None:
        order = list(range(len(self.axes)))
        for one, other in dict.fromkeys(self._swaps):
            order[one], order[other] = order[other], order[one]
        for axis, wheel in zip(self.axes, order, strict=True):
            axis.socket.plug(self.axes[wheel].own_encoder)
        self._connect()

    def _connect(self) -> None:
        """Pass the encoders' speeds on to the loops in the drives."""
        for axis in self.axes:
            encoder = axis.socket.encoder
            axis.true.feed_speed_loop(encoder.wheel, encoder.loop_factor)

    def lose_voltage(self, lost_v: float) -> None:
        """Lower the supply at the bridges [V]; negative: restore it."""
        self._lost_v = _without_dust(self._lost_v + lost_v)
        self._pass_on()

    def hold_voltage(self, cause: object, ceiling_v: float | None) -> None:
        """Limit the supply for a cause to a ceiling [V]; None: the cause is over."""
        if ceiling_v is None:
            self._ceilings_v.pop(cause, None)
        else:
            self._ceilings_v[cause] = ceiling_v
        self._pass_on()

    def _pass_on(self) -> None:
        self.is_low = bool(self._lost_v or self._ceilings_v)
        share = self.share
        for axis in self.axes:
            axis.true.supply = share

    def holds_in_reset(self) -> bool:
        """Return whether the present supply holds the drive's processor in reset.

        Without a fault it never does, however low this robot's battery is.
        """
        limit_v = RELEASE_V if self._in_reset else RESET_V
        self._in_reset = self.is_low and self.bus_voltage_v < limit_v
        return self._in_reset

    @property
    def share(self) -> float:
        """Supply at the bridges, as a share of its value without a fault."""
        return self.bus_voltage_v / self.plant.bus_voltage_v

    # What the firmware sees and does ------------------------------------------------------------

    @property
    def bus_voltage_v(self) -> float:
        """Supply at the bridges [V]."""
        left_v = self.plant.bus_voltage_v - self._lost_v
        return max(min((left_v, *self._ceilings_v.values())), 0.0)

    @property
    def steering_rad(self) -> float:
        """Measured steering angle [rad]."""
        return self.plant.steering_rad

    def steer(self, angle_rad: float) -> None:
        """Demand an angle of the servo [rad]."""
        self.plant.steer(angle_rad)

    def fit_brake_resistor(self, resistor: BrakeResistor | None) -> None:
        """Put a brake resistor on the rail, or take it away."""
        self.plant.fit_brake_resistor(resistor)

    @property
    def brake_resistor_a(self) -> float:
        """Current through the brake resistor [A]."""
        return self.plant.brake_resistor_a


class FaultyRing:
    """The sonars as the ring's firmware reads them.

    Parameters
    ----------
    ring
        True ring.
    mounts
        Positions of its sonars.
    """

    def __init__(self, ring: SonarRing, mounts: Sequence[SonarMount]) -> None:
        self._ring = ring
        self._mounts = mounts
        self._leaks: list[tuple[int, int]] = []
        self._stuck = 0
        self._last: dict[int, Ranges] = {}

    def stick(self) -> Undo:
        """Repeat the last ranges of each group."""
        self._change_stuck(1)
        return partial(self._change_stuck, -1)

    def _change_stuck(self, by: int) -> None:
        self._stuck += by

    def leak(self, listener: int, speaker: int) -> Undo:
        """Make one sonar mistake the echo of another for its own.

        Raises
        ------
        SimulationError
            If the robot has no such sonars, or the two do not fire together.
        """
        count = len(self._mounts)
        if max(listener, speaker) >= count:
            raise SimulationError(f"the robot has {count} sonars, counted from 0")
        if listener == speaker or listener // GROUP_SIZE != speaker // GROUP_SIZE:
            raise SimulationError(
                f"sonars {listener} and {speaker} do not fire together, only those of one group "
                f"of {GROUP_SIZE} do"
            )
        pair = listener, speaker
        self._leaks.append(pair)
        return partial(self._leaks.remove, pair)

    def fire(self, group: int, x_m: float, y_m: float, theta_rad: float) -> Ranges:
        """Return the ranges [m] of a group fired from a pose of base in world."""
        if self._stuck and group in self._last:
            return self._last[group]
        ranges_m = self._ring.fire(group, x_m, y_m, theta_rad)
        for listener, speaker in self._leaks:
            if listener // GROUP_SIZE == group:
                ranges_m = self._mixed(ranges_m, listener, speaker)
        self._last[group] = ranges_m
        return ranges_m

    def _mixed(self, ranges_m: Ranges, listener: int, speaker: int) -> Ranges:
        """Return a group's ranges in which one sonar reports another's earlier echo.

        The sound goes from the speaker to its target and from there straight to the listener,
        which reports half the distance.
        """
        there_m = ranges_m[speaker % GROUP_SIZE]
        if math.isinf(there_m):
            return ranges_m
        here, other = self._mounts[listener], self._mounts[speaker]
        heading_rad = math.radians(other.heading_deg)
        x_m = other.x_m + there_m * math.cos(heading_rad)
        y_m = other.y_m + there_m * math.sin(heading_rad)
        back_m = math.hypot(x_m - here.x_m, y_m - here.y_m)
        mixed = list(ranges_m)
        mixed[listener % GROUP_SIZE] = min(
            ranges_m[listener % GROUP_SIZE], round(500.0 * (there_m + back_m)) / 1000.0
        )
        first, second, third, fourth = mixed
        return first, second, third, fourth


def _without_dust(volts: float) -> float:
    """Return 0 if only rounding errors are left."""
    return 0.0 if abs(volts) < 1e-9 else volts
