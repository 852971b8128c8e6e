"""The power state machine of one axis (CiA 402-2, figure 4), and how it brakes."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_sim.drives.twin import Motor
from firmware_sim.plant.axis import Limits, Mode

STILL_RAD_S: Final = 0.05
"""Speed of the motor below which a stop is over [rad/s]."""


class State(enum.IntEnum):
    """States, with their values of the status word."""

    NOT_READY_TO_SWITCH_ON = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


class Stop(enum.IntEnum):
    """Ways to stop, the values of 605Ah to 605Eh."""

    COAST = 0
    SLOW_DOWN_RAMP = 1
    QUICK_STOP_RAMP = 2
    CURRENT_LIMIT = 3
    VOLTAGE_LIMIT = 4


STAYS: Final = 4
"""Quick stop options above this are those of `Stop` plus 4; the axis then stays in quick stop."""

_SETTLES_NS: Final = 100_000_000
"""Time after the end of a ramp after which a motor that still turns is released [ns]."""
_BRAKES_NS: Final = 1_000_000_000
"""Maximum time of braking at the current limit [ns]."""

_HOLDS_NS: Final = 50_000_000
"""Time for which a motor braked at the current limit must stand before its release [ns]: a wheel
may have locked on a sliding robot."""

_VOLTAGE_ENABLED, _REMOTE = 0x10, 0x200
_TARGET_REACHED, _INTERNAL_LIMIT = 0x400, 0x800
_HALT: Final = 0x100
_FAULT_RESET: Final = 0x80


@dataclass(slots=True)
class Options:
    """Ways in which an axis stops on commands and faults: objects 605Ah to 605Eh."""

    quick_stop: int = Stop.QUICK_STOP_RAMP
    shutdown: int = Stop.COAST
    disable: int = Stop.SLOW_DOWN_RAMP
    halt: int = Stop.SLOW_DOWN_RAMP
    fault: int = Stop.QUICK_STOP_RAMP


@dataclass(slots=True)
class Ramps:
    """Ramps of an axis at its motor [rad/s^2]."""

    acceleration: float
    deceleration: float
    quick_stop: float


class PowerAxis:
    """One axis with its motor.

    Parameters
    ----------
    motor
        The motor.
    ratio
        Motor turns per wheel turn, > 0.
    current_limit_a
        Maximum current of the motor [A].
    speed_max_rad_s
        Maximum speed of the motor [rad/s].
    options
        Reactions to commands and faults.
    ramps
        Returns its ramps, for a target speed [rad/s].

    Attributes
    ----------
    state
        Present state.
    target_rad_s
        Target velocity of the motor [rad/s].
    error
        Its error code; 0: none.
    is_stopping
        Whether a stop is in progress, which needs frequent checks.
    """

    def __init__(
        self,
        motor: Motor,
        ratio: float,
        current_limit_a: float,
        speed_max_rad_s: float,
        options: Callable[[], Options],
        ramps: Callable[[float], Ramps],
    ) -> None:
        self.motor = motor
        self._ratio = ratio
        self._current_limit_a = current_limit_a
        self._speed_max_rad_s = speed_max_rad_s
        self._options = options
        self._ramps = ramps
        self.state = State.NOT_READY_TO_SWITCH_ON
        self.target_rad_s = 0.0
        self.error = 0
        self.has_cause = False
        """Whether the cause of the fault persists, so that a reset has no effect."""
        self.is_stopping = False
        self._then = State.SWITCH_ON_DISABLED
        self._ramp_ns: int | None = None
        """Length of the ramp of a stop that has just begun [ns]."""
        self._sense = 1.0
        """Sign of the speed when the stop began."""
        self._turned_ns = self._hold_ns = 0
        """Time of the motor's last motion, and how long it must stand [ns]."""
        self._rest_ns = 0
        """End of that ramp [ns]."""
        self._word = 0

    def power_up(self) -> None:
        """Start without power, not ready."""
        self._release(State.NOT_READY_TO_SWITCH_ON)
        self.target_rad_s = 0.0
        self.error, self.has_cause = 0, False
        self._word = 0

    def initialise(self) -> None:
        """Finish the initialisation: leave "not ready to switch on"."""
        if self.state is State.NOT_READY_TO_SWITCH_ON:
            self.state = State.SWITCH_ON_DISABLED

    @property
    def status_word(self) -> int:
        """Object 6041h."""
        word = self.state | _VOLTAGE_ENABLED | _REMOTE
        if self.state is State.OPERATION_ENABLED:
            if abs(self.target_rad_s) > self._speed_max_rad_s:
                word |= _INTERNAL_LIMIT
            if (
                abs(self.target_rad_s - self.motor.speed_rad_s)
                < 0.02 * abs(self.target_rad_s) + 0.1
            ):
                word |= _TARGET_REACHED
        return word

    def control(self, word: int) -> None:
        """Take a control word (CiA 402-2, table 29)."""
        rising, self._word = word & ~self._word, word
        state = self.state
        if state is State.FAULT:
            if rising & _FAULT_RESET and not self.has_cause:
                self.error = 0
                self.state = State.SWITCH_ON_DISABLED
        elif state in (State.FAULT_REACTION_ACTIVE, State.NOT_READY_TO_SWITCH_ON):
            return
        elif not word & 0x02:
            self._release(State.SWITCH_ON_DISABLED)
        elif not word & 0x04:
            self._quick_stop()
        elif word & 0x07 == 0x06:
            self._shut_down()
        elif word & 0x0F == 0x07:
            self._switch_on()
        elif word & 0x0F == 0x0F:
            self._enable()

    def _quick_stop(self) -> None:
        if self.state in (State.READY_TO_SWITCH_ON, State.SWITCHED_ON):
            self._release(State.SWITCH_ON_DISABLED)
        elif self.state is State.OPERATION_ENABLED:
            self.quick_stop()

    def quick_stop(self) -> None:
        """Stop as 605Ah says, then remove power unless that says otherwise."""
        option = self._options().quick_stop
        stays = option > STAYS
        self.state = State.QUICK_STOP_ACTIVE
        then = State.QUICK_STOP_ACTIVE if stays else State.SWITCH_ON_DISABLED
        self._stop(Stop(option - STAYS if stays else option), then)

    def _shut_down(self) -> None:
        if self.state in (State.SWITCH_ON_DISABLED, State.SWITCHED_ON):
            self._release(State.READY_TO_SWITCH_ON)
        elif self.state is State.OPERATION_ENABLED:
            self.state = State.READY_TO_SWITCH_ON
            self._stop(Stop(self._options().shutdown), State.READY_TO_SWITCH_ON)

    def _switch_on(self) -> None:
        if self.state is State.READY_TO_SWITCH_ON:
            self.state = State.SWITCHED_ON
        elif self.state is State.OPERATION_ENABLED:
            self.state = State.SWITCHED_ON
            self._stop(Stop(self._options().disable), State.SWITCHED_ON)

    def _enable(self) -> None:
        if self.state is State.SWITCHED_ON or (
            self.state is State.QUICK_STOP_ACTIVE and self._options().quick_stop > STAYS
        ):
            self.state = State.OPERATION_ENABLED
            self.is_stopping = False
        if self.state is State.OPERATION_ENABLED:
            self.drive()

    def drive(self) -> None:
        """Follow the target velocity, or halt."""
        if self.state is not State.OPERATION_ENABLED:
            return
        halts = self._word & _HALT
        option = Stop(self._options().halt) if halts else Stop.SLOW_DOWN_RAMP
        if option in (Stop.CURRENT_LIMIT, Stop.VOLTAGE_LIMIT):
            self._brake()
            return
        top = self._speed_max_rad_s
        target = 0.0 if halts else min(max(self.target_rad_s, -top), top)
        ramps = self._ramps(target)
        slower = abs(target) < abs(self.motor.speed_rad_s)
        ramp = ramps.deceleration if slower else ramps.acceleration
        self._run(target, ramps.quick_stop if option is Stop.QUICK_STOP_RAMP else ramp)

    def fault(self, code: int) -> None:
        """Stop as 605Eh says, then show a fault."""
        self.error = code
        self.has_cause = True
        if self.state in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            return
        was_on = self.state in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
        self.state = State.FAULT_REACTION_ACTIVE
        self._stop(Stop(self._options().fault) if was_on else Stop.COAST, State.FAULT)

    def release(self) -> None:
        """Remove power at once; the motor coasts."""
        if self.state not in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            self._release(State.SWITCH_ON_DISABLED)

    def brake(self) -> None:
        """Brake at the current limit, then remove power."""
        if self.state is State.OPERATION_ENABLED:
            self.state = State.QUICK_STOP_ACTIVE
            self._stop(Stop.CURRENT_LIMIT, State.SWITCH_ON_DISABLED)

    def step(self, now_ns: int) -> None:
        """Check whether a stop is over: the motor stands, or its ramp has ended."""
        if not self.is_stopping:
            return
        if self._ramp_ns is not None:
            self._rest_ns, self._ramp_ns = now_ns + self._ramp_ns, None
            self._turned_ns = now_ns
        turns = self.motor.speed_rad_s * self._sense >= STILL_RAD_S
        if turns:
            self._turned_ns = now_ns
        stood = not turns and now_ns - self._turned_ns >= self._hold_ns
        if stood or now_ns >= self._rest_ns:
            if self._then is State.QUICK_STOP_ACTIVE:
                self.is_stopping = False
            else:
                self._release(self._then)

    # The bridge ---------------------------------------------------------------------------------

    def _release(self, state: State) -> None:
        self.state = state
        self.is_stopping = False
        self.motor.command(Mode.COAST)

    def _stop(self, how: Stop, then: State) -> None:
        """Come to rest, then enter a state without power."""
        if how is Stop.COAST:
            self._release(then)
            return
        self.is_stopping, self._then = True, then
        self._sense = math.copysign(1.0, self.motor.speed_rad_s)
        if how in (Stop.CURRENT_LIMIT, Stop.VOLTAGE_LIMIT):
            self._ramp_ns, self._hold_ns = _BRAKES_NS, _HOLDS_NS
            self._brake()
        else:
            ramps = self._ramps(0.0)
            by_quick_stop = how is Stop.QUICK_STOP_RAMP
            ramp = ramps.quick_stop if by_quick_stop else ramps.deceleration
            self._ramp_ns = round(1e9 * abs(self.motor.speed_rad_s) / ramp) + _SETTLES_NS
            self._hold_ns = 0
            self._run(0.0, ramp)

    def _run(self, speed_rad_s: float, ramp_rad_s2: float) -> None:
        self._limit(ramp_rad_s2)
        self.motor.command(Mode.SPEED, speed_rad_s)

    def _brake(self) -> None:
        self._limit(None)
        self.motor.command(Mode.BRAKE_CURRENT, self._current_limit_a)

    def _limit(self, ramp_rad_s2: float | None) -> None:
        """Set the limits of the bridge, if they change."""
        limits = Limits(current_a=self._current_limit_a)
        if ramp_rad_s2 is not None:
            limits = Limits(
                current_a=self._current_limit_a, acceleration_rad_s2=ramp_rad_s2 / self._ratio
            )
        if limits != self.motor.axis.limits:
            self.motor.axis.limits = limits
