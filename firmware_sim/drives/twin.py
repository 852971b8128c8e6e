"""Common parts of all twins: frames in, frames out, and an alarm clock.

A twin receives every frame at its exact time (`on_frame`) and is woken at the time of `_due_ns`. It
behaves as its maker documents; undocumented behaviour is a setting of its table
`[simulation.twin.NAME]`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from firmware_sim.nodes.node import NEVER_NS, CanFrame, CanPort
from firmware_sim.nodes.parameter_store import ParameterStore, StoreDamagedError
from firmware_sim.nodes.power_stage import Encoder, MotorAxis
from firmware_sim.nodes.variables import Key
from firmware_sim.plant.axis import Limits, Mode

__all__ = ["NEVER_NS", "CanFrame", "Motor", "Twin", "stored"]

_FINEST: Final = 1 << 20
"""Counts of a motor's encoder per turn: more than any drive reports."""


def stored(store: ParameterStore) -> dict[Key, int]:
    """Return the contents of a drive's memory: nothing if damaged."""
    try:
        return store.load()
    except StoreDamagedError:
        return {}


class Twin:
    """Base of the twins.

    Parameters
    ----------
    name
        Name of the drive in the robot's file.
    run_to
        Function that brings the plant to a time [ns] (the last whole millisecond up to it) and
        returns the time of its state; called before motors are read or commanded.
    """

    def __init__(self, name: str, run_to: Callable[[int], int]) -> None:
        self.name = name
        self._run_to = run_to
        self._port: CanPort | None = None
        self._alarm: Callable[[int, Any], object] | None = None
        self._alarm_ns = NEVER_NS
        self._now_ns = 0
        self._handlers: dict[int, Callable[[bytes, int], None]] = {}

    @property
    def arbitration_ids(self) -> tuple[int, ...]:
        """Identifiers it listens to (its acceptance filter)."""
        return tuple(self._handlers)

    def connect(self, port: CanPort, alarm: Callable[[int, Any], object]) -> None:
        """Connect the twin to its port, and to `alarm`, which has `wake` called at a time [ns]."""
        self._port = port
        self._alarm = alarm
        self._alarm_ns = NEVER_NS

    def power_cycle(self, now_ns: int) -> None:
        """Switch the supply off and on: all but stored settings is lost."""
        self._now_ns = now_ns
        self._run_to(now_ns)
        self._on_power_up(now_ns)
        self._reschedule()

    def on_frame(self, frame: CanFrame) -> None:
        """Take one frame from the bus."""
        handler = self._handlers.get(frame.arbitration_id)
        if handler is not None:
            self._now_ns = frame.stamp_ns
            handler(frame.data, frame.stamp_ns)
            self._reschedule()

    def wake(self, now_ns: int) -> None:
        """Take an alarm at `now_ns` [ns]; one that has been overtaken does nothing."""
        if now_ns < self._alarm_ns:
            return
        self._alarm_ns = NEVER_NS
        self._now_ns = now_ns
        if now_ns >= self._due_ns():
            self._step(now_ns)
        self._reschedule()

    def trip(self, code: int) -> None:
        """Raise a fault with one of its maker's codes."""

    def heal(self) -> None:
        """Remove the cause of a fault, for drives in which it lasts."""

    def send(self, arbitration_id: int, data: bytes) -> None:
        """Send one frame if the twin is on a bus."""
        if self._port is not None:
            self._port.send(arbitration_id, data)

    # What a kind of drive adds ------------------------------------------------------------------

    def _on_power_up(self, now_ns: int) -> None:
        """Start afresh, motors without power."""

    def _step(self, now_ns: int) -> None:
        """Do the work due now."""

    def _due_ns(self) -> int:
        """Return the next time for `_step` [ns]."""
        return NEVER_NS

    def _reschedule(self) -> None:
        due_ns = self._due_ns()
        if due_ns < self._alarm_ns and self._alarm is not None:
            self._alarm_ns = due_ns
            self._alarm(max(due_ns, self._now_ns), self)


class Motor:
    """An axis seen at the motor's shaft, as by a drive; a `MotorAxis` itself.

    Parameters
    ----------
    axis
        The axis, seen at the wheel.
    ratio
        Motor turns per wheel turn, negative for a motor mounted the other way round.
    """

    def __init__(self, axis: MotorAxis, ratio: float) -> None:
        self.axis = axis
        self._ratio = ratio
        self._sign = 1 if ratio > 0.0 else -1
        # One, since an axis has one encoder, with the resolution of the last request.
        self._encoder = axis.encoder(_FINEST * abs(ratio))

    def command(self, mode: Mode, value: float = 0.0) -> None:
        """Command the bridge; a speed is the motor's [rad/s], a duty or current signed."""
        if mode is Mode.SPEED:
            value /= self._ratio
        elif mode in (Mode.DUTY, Mode.CURRENT):
            value *= self._sign
        self.axis.command(mode, value)

    def encoder_count(self, counts_per_turn: float) -> int:
        """Return the counts of an encoder on the motor's shaft since power-on, unbounded."""
        return math.floor(self.turns * counts_per_turn)

    @property
    def turns(self) -> float:
        """Angle of the shaft since power-on [turn], by its encoder."""
        return self._sign * self._encoder.count / _FINEST

    def encoder(self, counts_per_revolution: float) -> Encoder:
        """Return an encoder on the shaft."""
        return _ShaftEncoder(self, counts_per_revolution)

    @property
    def limits(self) -> Limits:
        """Limits and gains of the drive's loops, at the wheel."""
        return self.axis.limits

    @limits.setter
    def limits(self, limits: Limits) -> None:
        self.axis.limits = limits

    @property
    def temperature_c(self) -> float:
        """Winding temperature [degC]."""
        return self.axis.temperature_c

    @property
    def voltage_v(self) -> float:
        """Mean voltage at the motor [V]."""
        return self.axis.voltage_v * self._sign

    @property
    def supply_current_a(self) -> float:
        """Mean current out of the supply [A]; negative feeds back."""
        return self.axis.supply_current_a

    @property
    def speed_rad_s(self) -> float:
        """Speed of the shaft [rad/s]."""
        return self.axis.speed_rad_s * self._ratio

    @property
    def current_a(self) -> float:
        """Current [A], positive with torque in the motor's positive direction."""
        return self.axis.current_a * self._sign


class _ShaftEncoder:
    """An encoder on a motor's shaft."""

    def __init__(self, motor: Motor, counts_per_turn: float) -> None:
        self._motor, self._counts_per_turn = motor, counts_per_turn

    @property
    def count(self) -> int:
        """Counts since power-on, unbounded."""
        return self._motor.encoder_count(self._counts_per_turn)
