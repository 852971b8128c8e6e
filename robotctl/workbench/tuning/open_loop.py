"""Experiments without the control core: duties sent to the wheels, and the wheels' response."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from robotctl.app.processes.robot import feedback_ages
from robotctl.app.simulation.lockstep_stack import LockstepStack
from robotctl.config.robot_file import RobotConfig
from robotctl.control.identification.tuning import Relay
from robotctl.control.pwm import PwmConfig, PwmMap
from robotctl.control.wheel_velocity import WheelVelocityEstimator
from robotctl.core.control_core import Inputs
from robotctl.messages.actuators import ActuatorCommand
from robotctl.safety.health import Health
from robotctl.workbench.tuning.track import READY_S, Array, ExperimentError, check_room

_OFF: Final = ActuatorCommand(enable=False, brake=True)
_RAMP_PER_S: Final = 0.2
_STEPS_FORWARDS: Final = (1.0, 0.5, 1.0, 0.5, 1.0, 0.5, 0.75, 0.25)
_STEPS_BACKWARDS: Final = (0.5, 1.0, 0.5, 1.0, 0.5, 0.25)
_TURN_S: Final = 0.3
_RELAY_AMPLITUDE: Final = 0.3
_RELAY_HYSTERESIS: Final = 0.1
_RELAY_SWITCHES: Final = 40


@dataclass(frozen=True, slots=True)
class OpenLoopRecord:
    """The wheels' response to given duties. Wheel arrays have the shape (n, wheels).

    Parameters
    ----------
    time_s
        Time of each tick, shape (n,) [s].
    duty
        Sent in that tick, the same to all wheels, shape (n,) [-1, 1].
    bus_voltage_v
        As the drive reported it last, shape (n,) [V].
    velocity_rad_s
        Speed by the loop's own estimator in that tick, before the duty was sent [rad/s].
    position_rad
        Angle of the wheel at that tick: it came one period later, and is moved back here [rad].
    """

    time_s: Array
    duty: Array
    bus_voltage_v: Array
    velocity_rad_s: Array
    position_rad: Array


Law: TypeAlias = Callable[[float, float], float]
"""Function of the wheels' mean speed [rad/s] and the supply [V]: the duty of all wheels."""


class OpenLoop:
    """Drives all wheels equally and straight ahead, bypassing the control core, and records.

    The drive is watched as the control core would watch it.

    Parameters
    ----------
    stack, config
        The robot.

    Raises
    ------
    ExperimentError
        If the nodes do not become ready.
    """

    def __init__(self, stack: LockstepStack, config: RobotConfig) -> None:
        self._stack = stack
        self._health = Health(
            feedback_ages(config),
            config.safety.heartbeat_timeout_ms * 1_000_000,
            stack.core.actuators,
        )
        drive = config.drive
        self._wheels = tuple(
            WheelVelocityEstimator(drive.counts_per_revolution) for _ in drive.wheel_names
        )
        self._held_rad = (0.0,) * len(drive.joint_names)
        self._rows: list[tuple[float, ...]] = []
        self.dt_s = stack.period_ns * 1e-9
        for _ in range(round(READY_S / self.dt_s)):
            stack.open_loop_tick(self._wait)
            refusals = self._health.refusals(stack.clock.now_ns())
            if not refusals:
                self._health.armed(stack.clock.now_ns())
                break
        else:
            raise ExperimentError(f"the robot is not ready: {'; '.join(map(str, refusals))}")

    @property
    def ticks(self) -> int:
        """Length of the record."""
        return len(self._rows)

    @property
    def speed_rad_s(self) -> float:
        """Mean speed of the wheels, as estimated last [rad/s]."""
        return sum(wheel.velocity_rad_s for wheel in self._wheels) / len(self._wheels)

    @property
    def bus_voltage_v(self) -> float:
        """Supply as reported last [V]."""
        reports = self._health.reports
        return reports[0].voltage_v or 0.0 if reports else 0.0

    def hold(self, duty: float, duration_s: float) -> None:
        """Drive with a duty for a time [s]."""
        for _ in range(round(duration_s / self.dt_s)):
            self.tick(lambda _speed, _supply: duty)

    def sweep(self, to_duty: float, duration_s: float) -> None:
        """Bring the duty from its present value to another at a constant rate, in a time [s]."""
        begin = self._rows[-1][1] if self._rows else 0.0
        n = max(1, round(duration_s / self.dt_s))
        for i in range(1, n + 1):
            self.hold(begin + (to_duty - begin) * i / n, self.dt_s)

    def tick(self, law: Law) -> None:
        """Let one period pass and send the duty given by `law`.

        Raises
        ------
        ExperimentError
            If the drive reports a fault, or there is not enough room.
        """
        self._stack.open_loop_tick(lambda inputs: self._command(inputs, law))
        problem = self._health.fault(self._stack.clock.now_ns())
        if problem is not None:
            raise ExperimentError(f"the experiment was stopped: {problem}")
        check_room(self._stack)

    def _wait(self, inputs: Inputs) -> ActuatorCommand:
        self._take(inputs)
        return _OFF

    def _take(self, inputs: Inputs) -> None:
        self._health.update(inputs.feedback)
        for estimator, report in zip(self._wheels, inputs.feedback.actuators, strict=False):
            if report.latch_us >= 0:
                estimator.update(report.position_ticks, report.latch_us)

    def _command(self, inputs: Inputs, law: Law) -> ActuatorCommand:
        self._take(inputs)
        supply_v = self.bus_voltage_v
        duty = law(self.speed_rad_s, supply_v)
        self._rows.append(
            (
                self._stack.clock.now_ns() * 1e-9,
                duty,
                supply_v,
                *(wheel.velocity_rad_s for wheel in self._wheels),
                *(wheel.position_rad for wheel in self._wheels),
            )
        )
        return ActuatorCommand(True, False, (duty,) * len(self._wheels) + self._held_rad)

    def record(self) -> OpenLoopRecord:
        """Return everything driven so far, without the last tick."""
        rows = np.array(self._rows, dtype=np.float64)
        n = len(self._wheels)
        return OpenLoopRecord(
            time_s=rows[:-1, 0],
            duty=rows[:-1, 1],
            bus_voltage_v=rows[:-1, 2],
            velocity_rad_s=rows[:-1, 3 : 3 + n],
            position_rad=rows[1:, 3 + n :],
        )


def find_duty(open_loop: OpenLoop, speed_rad_s: float, max_duty: float) -> float:
    """Raise the duty slowly until the wheels turn at a speed; return it (or `max_duty`, if near).

    Raises
    ------
    ExperimentError
        If the wheels turn backwards, or much too slowly at `max_duty`.
    """
    duty = 0.0
    while open_loop.speed_rad_s < speed_rad_s and duty < max_duty:
        duty = min(duty + _RAMP_PER_S * open_loop.dt_s, max_duty)
        open_loop.hold(duty, open_loop.dt_s)
        if open_loop.speed_rad_s < -0.2 * speed_rad_s:
            raise ExperimentError(
                f"the wheels turn backwards at a duty of {duty:+.2f}: a motor or an encoder is "
                "reversed"
            )
    if open_loop.speed_rad_s < 0.5 * speed_rad_s:
        raise ExperimentError(
            f"at a duty of {duty:.2f} the wheels turn at {open_loop.speed_rad_s:.1f} rad/s only; "
            f"the experiment needs {0.5 * speed_rad_s:.1f} rad/s at least"
        )
    return duty


def staircase(open_loop: OpenLoop, top_duty: float, hold_s: float) -> None:
    """Step between duties forwards, then backwards, each held for a time [s], and stop.

    Several steady speeds separate friction from back-EMF; the steps between them give inertia. From
    forwards to backwards it goes slowly, so that the current limit is not met.
    """
    for level in _STEPS_FORWARDS:
        open_loop.hold(level * top_duty, hold_s)
    open_loop.sweep(0.0, _TURN_S)
    open_loop.sweep(-_STEPS_BACKWARDS[0] * top_duty, _TURN_S)
    for level in _STEPS_BACKWARDS:
        open_loop.hold(-level * top_duty, hold_s)
    open_loop.sweep(0.0, _TURN_S)
    open_loop.hold(0.0, _TURN_S)


@dataclass(frozen=True, slots=True)
class RelayRun:
    """A relay experiment: the relay, and its record from tick `begin` on."""

    relay: Relay
    begin: int


def relay_run(
    open_loop: OpenLoop,
    pwm: PwmConfig,
    speed_rad_s: float,
    holding_v: float,
    time_out_s: float = 20.0,
) -> RelayRun:
    """Let a relay swing the mean speed of the wheels round `speed_rad_s`.

    Parameters
    ----------
    open_loop
        The robot.
    pwm
        Its bridge.
    speed_rad_s
        Wanted mean speed, > 0 [rad/s]. The hysteresis is a tenth of it, so that cycles are long
        against the estimator's resolution; it makes the result a little cautious.
    holding_v
        What about holds that speed [V]. The relay's amplitude is 30 % of it.
    time_out_s
        Longest duration [s]; a record too short shows when it is evaluated.
    """
    relay = Relay(_RELAY_AMPLITUDE * holding_v, _RELAY_HYSTERESIS * speed_rad_s, holding_v)
    bridge = PwmMap(pwm)
    outputs: list[float] = []

    def law(speed: float, supply_v: float) -> float:
        outputs.append(relay.step(speed_rad_s, speed))
        return bridge.step(outputs[-1], supply_v, open_loop.dt_s)

    begin, switches = open_loop.ticks, 0
    while switches < _RELAY_SWITCHES and len(outputs) * open_loop.dt_s < time_out_s:
        open_loop.tick(law)
        switches += len(outputs) > 1 and outputs[-1] != outputs[-2]
    return RelayRun(relay, begin)
