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
    from firmware_sim.plant.plant import Bridge, Plant
    from firmware_sim.sensors.sonar import SonarRing

SOUND: Final = 1
STUCK: Final = 0
REVERSED: Final = -1

RESET_V: Final = 6.0
"""Below this supply the drive's processor is held in reset,"""
RELEASE_V: Final = 6.5
"""and above this one it starts again."""


class _Encoder:
    """Counts of a wheel's encoder: continuous across changes of its faults."""

    def __init__(self, true: Callable[[], int]) -> None:
        self._true_now = true
        self._present: list[BrokenEncoder] = []
        self._read = self._true = 0

    @property
    def count(self) -> int:
        """Counts of the encoder."""
        factor = self._present[-1].factor if self._present else SOUND
        return self._read + factor * (self._true_now() - self._true)

    def begin(self, factor: int) -> BrokenEncoder:
        """From now on count by a factor."""
        self._anchor()
        fault = BrokenEncoder(self, factor)
        self._present.append(fault)
        return fault

    def end(self, fault: BrokenEncoder) -> None:
        """End one fault."""
        self._anchor()
        self._present.remove(fault)

    def shows(self, fault: BrokenEncoder) -> bool:
        """Whether a fault is the latest, which counts."""
        return bool(self._present) and self._present[-1] is fault

    def _anchor(self) -> None:
        self._read, self._true = self.count, self._true_now()


class BrokenEncoder:
    """One fault of an encoder: it counts by a factor while no later one is present."""

    def __init__(self, encoder: _Encoder, factor: int) -> None:
        self._encoder = encoder
        self.factor = factor

    @property
    def counts(self) -> bool:
        """Whether this is the fault that is seen."""
        return self._encoder.shows(self)

    def end(self) -> None:
        """End it."""
        self._encoder.end(self)


class FaultyStage:
    """The power stage as the drive's firmware sees it, between it and the plant.

    Parameters
    ----------
    plant
        The true one.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._encoders = (_Encoder(lambda: plant.count1), _Encoder(lambda: plant.count2))
        self._offsets = [0, 0]
        """Of the counters of the channels to the encoders that they count."""
        self._swaps = 0
        self._blocks = [0, 0]
        self._added_a = [0.0, 0.0]
        self._added_c = [0.0, 0.0]
        self._lost_v = 0.0
        self._ceilings_v: dict[object, float] = {}
        self._in_reset = False
        self._commanded: tuple[float, float, float, Bridge] | None = None

    # Faults -------------------------------------------------------------------------------------

    def break_encoder(self, wheel: int, factor: int) -> BrokenEncoder:
        """Let the encoder of a wheel count by a factor: `STUCK` or `REVERSED`."""
        return self._encoders[wheel].begin(factor)

    def jump(self, wheel: int, counts: int) -> None:
        """Let the count of a wheel's encoder jump once."""
        self._offsets[self._other_if_swapped(wheel)] += counts

    def swap(self) -> Undo:
        """Plug the cables of the encoders into each other's sockets."""
        self._change_swaps(1)
        return lambda: self._change_swaps(-1)

    def _change_swaps(self, by: int) -> None:
        before = self.count1, self.count2
        self._swaps += by
        self._offsets = [before[channel] - self._plugged(channel).count for channel in (0, 1)]

    def block(self, channel: int) -> Undo:
        """Hold a wheel, whose motor stalls."""
        self._change_blocks(channel, 1)
        return lambda: self._change_blocks(channel, -1)

    def _change_blocks(self, channel: int, by: int) -> None:
        self._blocks[channel] += by
        self._plant.block(channel + 1, blocked=self._blocks[channel] > 0)

    def add_current(self, channel: int, current_a: float) -> Undo:
        """Let a motor draw more current [A] in the direction of what it draws.

        Where it draws none it is that of its duty, and forward where that is 0 too.
        """
        return _add(self._added_a, channel, current_a)

    def add_heat(self, channel: int, rise_k: float) -> Undo:
        """Let a winding be hotter [K]."""
        return _add(self._added_c, channel, rise_k)

    def lose_voltage(self, lost_v: float) -> None:
        """Lower the supply at the bridges [V]; negative: restore it."""
        self._lost_v = _without_dust(self._lost_v + lost_v)
        self._pass_on()

    def hold_voltage(self, cause: object, ceiling_v: float | None) -> None:
        """Let a cause leave the supply no more than a ceiling [V]; None: it is over."""
        if ceiling_v is None:
            self._ceilings_v.pop(cause, None)
        else:
            self._ceilings_v[cause] = ceiling_v
        self._pass_on()

    def holds_in_reset(self) -> bool:
        """Return whether the drive's processor is held in reset, by its present supply.

        A supply without a fault holds it never, however low the battery of this robot is.
        """
        limit_v = RELEASE_V if self._in_reset else RESET_V
        self._in_reset = self._is_low and self.bus_voltage_v < limit_v
        return self._in_reset

    @property
    def _is_low(self) -> bool:
        return bool(self._lost_v or self._ceilings_v)

    # What the firmware sees and does ------------------------------------------------------------

    def _other_if_swapped(self, number: int) -> int:
        """Return the channel of a wheel, or the wheel of a channel."""
        return 1 - number if self._swaps else number

    def _plugged(self, channel: int) -> _Encoder:
        return self._encoders[self._other_if_swapped(channel)]

    @property
    def count1(self) -> int:
        """Count of channel 1."""
        return self._plugged(0).count + self._offsets[0]

    @property
    def count2(self) -> int:
        """Count of channel 2."""
        return self._plugged(1).count + self._offsets[1]

    @property
    def current1_a(self) -> float:
        """Current of motor 1 [A]."""
        return self._with_added(0, self._plant.current1_a)

    @property
    def current2_a(self) -> float:
        """Current of motor 2 [A]."""
        return self._with_added(1, self._plant.current2_a)

    def _with_added(self, channel: int, current_a: float) -> float:
        added_a = self._added_a[channel]
        if not added_a:
            return current_a
        duty = 0.0 if self._commanded is None else self._commanded[channel]
        return current_a + math.copysign(added_a, current_a or duty or 1.0)

    @property
    def temperature1_c(self) -> float:
        """Winding temperature of motor 1 [degC]."""
        return self._plant.temperature1_c + self._added_c[0]

    @property
    def temperature2_c(self) -> float:
        """Winding temperature of motor 2 [degC]."""
        return self._plant.temperature2_c + self._added_c[1]

    @property
    def bus_voltage_v(self) -> float:
        """Supply at the bridges [V]."""
        left_v = self._plant.bus_voltage_v - self._lost_v
        return max(min((left_v, *self._ceilings_v.values())), 0.0)

    @property
    def steering_rad(self) -> float:
        """Measured steering angle [rad]."""
        return self._plant.steering_rad

    def command(self, duty1: float, duty2: float, steering_rad: float, bridge: Bridge) -> None:
        """Pass a command on; with less than the supply the bridges give that much less."""
        self._commanded = duty1, duty2, steering_rad, bridge
        if self._is_low:
            self._pass_on()
        else:
            self._plant.command(duty1, duty2, steering_rad, bridge)

    def _pass_on(self) -> None:
        if self._commanded is None:
            return
        duty1, duty2, steering_rad, bridge = self._commanded
        share = self.bus_voltage_v / self._plant.bus_voltage_v
        self._plant.command(share * duty1, share * duty2, steering_rad, bridge)


class FaultyRing:
    """The sonars as the ring's firmware reads them.

    Parameters
    ----------
    ring
        The true one.
    mounts
        Where its sonars are.
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
        """Return a group's ranges in which one sonar takes another's earlier echo.

        The sound goes from the speaker to what it sees and from there straight to the listener,
        which takes half the distance for its range.
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


def _add(amounts: list[float], channel: int, amount: float) -> Undo:
    amounts[channel] += amount

    def end() -> None:
        amounts[channel] -= amount

    return end
