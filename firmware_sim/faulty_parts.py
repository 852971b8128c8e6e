"""What stands between the true robot and its firmware, and can break.

The true robot does what physics says while the firmware sees what is broken. A part without a
fault passes everything through unchanged.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

from firmware_sim.fault_kinds import Undo

if TYPE_CHECKING:
    from firmware_sim.nodes.sonar import Ranges
    from firmware_sim.plant import Bridge, Plant
    from firmware_sim.sonar import SonarRing

SOUND: Final = 1
STUCK: Final = 0
REVERSED: Final = -1


class _Encoder:
    """Counts as the firmware reads them: continuous whenever what is broken changes."""

    def __init__(self) -> None:
        self._factors: list[int] = []
        self._read = self._true = 0

    def read(self, true: int) -> int:
        """Return what is read where the wheel is truly at `true`; the last fault counts."""
        factor = self._factors[-1] if self._factors else SOUND
        return self._read + factor * (true - self._true)

    def anchor(self, read: int, true: int) -> None:
        """Read `read` where the wheel is truly at `true`."""
        self._read, self._true = read, true

    def begin(self, factor: int, true: int) -> None:
        """From now on count by a factor."""
        self.anchor(self.read(true), true)
        self._factors.append(factor)

    def end(self, factor: int, true: int) -> None:
        """End one of the faults with this factor."""
        self.anchor(self.read(true), true)
        self._factors.remove(factor)


class FaultyStage:
    """The power stage as the drive's firmware sees it, between it and the plant.

    Parameters
    ----------
    plant
        The true one.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._encoders = (_Encoder(), _Encoder())
        self._swaps = 0
        self._blocks = [0, 0]
        self._added_a = [0.0, 0.0]
        self._added_c = [0.0, 0.0]
        self._lost_v = 0.0

    # Faults -------------------------------------------------------------------------------------

    def break_encoder(self, channel: int, factor: int) -> Undo:
        """Let an encoder count by a factor: `STUCK` or `REVERSED`."""
        encoder = self._encoders[channel]
        encoder.begin(factor, self._true(channel))
        return lambda: encoder.end(factor, self._true(channel))

    def jump(self, channel: int, counts: int) -> None:
        """Let an encoder's count jump once."""
        true = self._true(channel)
        encoder = self._encoders[channel]
        encoder.anchor(encoder.read(true) + counts, true)

    def swap(self) -> Undo:
        """Plug the cables of the encoders into each other's sockets."""
        self._change_swaps(1)
        return lambda: self._change_swaps(-1)

    def _change_swaps(self, by: int) -> None:
        before = self.count1, self.count2
        self._swaps += by
        for channel in (0, 1):
            self._encoders[channel].anchor(before[channel], self._true(channel))

    def block(self, channel: int) -> Undo:
        """Hold a wheel, whose motor stalls."""
        self._change_blocks(channel, 1)
        return lambda: self._change_blocks(channel, -1)

    def _change_blocks(self, channel: int, by: int) -> None:
        self._blocks[channel] += by
        self._plant.block(channel + 1, blocked=self._blocks[channel] > 0)

    def add_current(self, channel: int, current_a: float) -> Undo:
        """Let a motor draw more current [A]."""
        return _add(self._added_a, channel, current_a)

    def add_heat(self, channel: int, rise_k: float) -> Undo:
        """Let a winding be hotter [K]."""
        return _add(self._added_c, channel, rise_k)

    def lose_voltage(self, lost_v: float) -> Undo:
        """Let the supply at the bridges be lower [V]."""
        self._lost_v += lost_v

        def end() -> None:
            self._lost_v -= lost_v

        return end

    # What the firmware sees and does ------------------------------------------------------------

    def _true(self, channel: int) -> int:
        return self._plant.count2 if (channel == 1) != (self._swaps > 0) else self._plant.count1

    @property
    def count1(self) -> int:
        """Count of channel 1."""
        return self._encoders[0].read(self._true(0))

    @property
    def count2(self) -> int:
        """Count of channel 2."""
        return self._encoders[1].read(self._true(1))

    @property
    def current1_a(self) -> float:
        """Current of motor 1 [A]."""
        return self._plant.current1_a + self._added_a[0]

    @property
    def current2_a(self) -> float:
        """Current of motor 2 [A]."""
        return self._plant.current2_a + self._added_a[1]

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
        return self._plant.bus_voltage_v - self._lost_v

    @property
    def steering_rad(self) -> float:
        """Measured steering angle [rad]."""
        return self._plant.steering_rad

    def command(self, duty1: float, duty2: float, steering_rad: float, bridge: Bridge) -> None:
        """Pass a command on."""
        self._plant.command(duty1, duty2, steering_rad, bridge)


class FaultyRing:
    """The sonars as the ring's firmware hears them.

    Parameters
    ----------
    ring
        The true one.
    """

    def __init__(self, ring: SonarRing) -> None:
        self._ring = ring
        self._stuck = 0
        self._last: dict[int, Ranges] = {}

    def stick(self) -> Undo:
        """Repeat the last ranges of each group."""
        self._change_stuck(1)
        return partial(self._change_stuck, -1)

    def _change_stuck(self, by: int) -> None:
        self._stuck += by

    def fire(self, group: int, x_m: float, y_m: float, theta_rad: float) -> Ranges:
        """Return the ranges [m] of a group fired from a pose of base in world."""
        if self._stuck and group in self._last:
            return self._last[group]
        ranges_m = self._ring.fire(group, x_m, y_m, theta_rad)
        self._last[group] = ranges_m
        return ranges_m


def _add(amounts: list[float], channel: int, amount: float) -> Undo:
    amounts[channel] += amount

    def end() -> None:
        amounts[channel] -= amount

    return end
