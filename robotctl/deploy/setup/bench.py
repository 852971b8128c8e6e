"""A robot's drives and sensors on their buses without the control core, moved slowly or not at all.

Each motion lasts a few seconds; it ends early when a drive reports an uncommanded motion, or when
the person interrupts. In between the motors are off.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol, Self

from robotctl.app.processes.robot import make_codec, make_parts
from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.can.config import MAX_SUPPLY_V
from robotctl.drivers.can.drives.fitting import actuators_of, fit
from robotctl.drivers.can.drives.motor_drive import MotorConfig, MotorDrive
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.drivers.can.robot_parts import RobotParts
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import Feedback, NodeStatus
from robotctl.messages.ports import CanPort, Clock
from robotctl.model.actuators import Actuator, Takes

SLOW_M_S: Final = 0.08
"""Speed of a wheel's rim in motions [m/s]."""
CREEP_M_S: Final = 0.03
"""Speed while ratios may be wrong [m/s]: up to sixfold, a wheel stays under `MOST_M_S`."""
STOP_M_S: Final = 0.15
"""Reported speed of a wheel at which a motion ends [m/s]."""
MOST_M_S: Final = 0.2
"""Maximum speed of a free wheel at the duty of a motion [m/s]."""

TURN_RAD: Final = 2.0
"""Turn of a wheel after which a motion may end [rad]."""
TURN_S: Final = 5.0
"""Maximum duration of a motion [s]."""
RISE_S: Final = 0.5
"""Ramp time of the speed [s]."""
DUTY_PER_S: Final = 0.05
"""Ramp of the duty [1/s]."""
ASTRAY_RAD: Final = 0.3
"""Turn of another wheel, or against the command, that ends a motion [rad]."""
WINDOW_NS: Final = 200_000_000
"""Window for the speed from positions [ns]."""
SILENT_NS: Final = 300_000_000
"""Age of a wheel's report at which a motion ends [ns]."""
COMMISSION_S: Final = 6.0
"""Time limit for the commissioning of drives and nodes [s]."""

_COAST: Final = ActuatorCommand(enable=False, brake=False)
_BRAKE: Final = ActuatorCommand(enable=False, brake=True)


class Buses(Protocol):
    """The robot's buses, real or simulated."""

    @property
    def clock(self) -> Clock:
        """Clock of the buses."""

    def open(self, identifiers: Mapping[str, Collection[int]]) -> dict[str, CanPort]:
        """Return a port on each bus, by its name, that accepts some identifiers.

        Raises
        ------
        LinkError
            If a bus cannot be opened.
        """


class Moved(NamedTuple):
    """Result of a motion.

    Attributes
    ----------
    turned_rad
        Reported turn of each wheel [rad].
    stopped
        Reason for an early end; empty without one.
    """

    turned_rad: tuple[float, ...]
    stopped: str


@dataclass(slots=True)
class Wheel:
    """A wheel and its reports.

    Attributes
    ----------
    place
        Index among the robot's actuators.
    name
        Name of the wheel.
    radius_m
        Radius [m].
    actuator
        Its actuator, with the abilities of its drive.
    ticks
        Position, unwrapped [tick].
    """

    place: int
    name: str
    radius_m: float
    actuator: Actuator
    ticks: int
    trail: deque[tuple[int, int]]
    """Time of reception [ns] and position of the newest reports."""

    @property
    def angle_rad(self) -> float:
        """Reported angle since the bench was opened [rad]."""
        return math.tau * self.ticks / self.actuator.ticks_per_revolution

    @property
    def from_positions_rad_s(self) -> float:
        """Speed from its positions [rad/s]."""
        (first_ns, first), (last_ns, last) = self.trail[0], self.trail[-1]
        if last_ns <= first_ns:
            return 0.0
        turns = (last - first) / self.actuator.ticks_per_revolution
        return math.tau * turns / ((last_ns - first_ns) * 1e-9)


class Bench:
    """A robot on the bench; a context manager, which leaves the motors off.

    Parameters
    ----------
    config
        The robot.
    buses
        Its buses.
    interrupts
        Returns whether a motion must stop now.
    slow_m_s
        Speed of a wheel's rim in motions [m/s].

    Attributes
    ----------
    config
        The robot.
    slow_m_s
        Speed of a wheel's rim in motions [m/s].
    wheels
        Driven wheels, in their order.
    feedback
        Newest feedback.
    """

    def __init__(
        self,
        config: RobotConfig,
        buses: Buses,
        interrupts: Callable[[], bool] = lambda: False,
        slow_m_s: float = SLOW_M_S,
    ) -> None:
        self.slow_m_s = slow_m_s
        self.config = config
        self.codec = make_codec()
        self.parts: RobotParts = make_parts(config, self.codec)
        self.buses = buses
        self._interrupts = interrupts
        self._clock = buses.clock
        names = [bus.name for bus in config.buses]
        self._robot = CanRobot(
            buses.open({name: self.parts.identifiers(name) for name in names}), self.parts
        )
        self.actuators = actuators_of(fit(config.drive, config.motors))
        self.wheels = tuple(
            Wheel(place, actuator.name, radius_m, actuator, 0, deque(((0, 0),)))
            for place, (actuator, radius_m) in enumerate(
                zip(self.actuators, config.drive.wheel_radii_m, strict=False)
            )
        )
        self.feedback = Feedback()
        self.period_ns = config.runtime.period_ns
        self._deadline_ns = self._clock.now_ns()
        self._known: list[int | None] = [None] * len(self.wheels)
        """Last reported position of each wheel."""

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Switch the motors off and release the buses."""
        self.close()

    def close(self) -> None:
        """Switch the motors off and release the buses."""
        self._robot.close()

    # Time ---------------------------------------------------------------------------------------

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""
        return self._clock.now_ns()

    def rest(self, seconds: float = 0.0, *, loose: bool = False) -> Feedback:
        """Keep the motors off for a time, at least one tick; braked unless `loose`."""
        end_ns = self.now_ns + round(seconds * 1e9)
        while True:
            self._tick(_COAST if loose else _BRAKE)
            if self.now_ns >= end_ns:
                return self.feedback

    def listen(self) -> Feedback:
        """Wait for a period and receive, without sending."""
        return self._tick(None)

    def _tick(self, command: ActuatorCommand | None) -> Feedback:
        """Wait for a period, receive, then send a command."""
        now_ns = self.now_ns
        # Ticks missed in a pause are not made up.
        self._deadline_ns = max(self._deadline_ns + self.period_ns, now_ns)
        self._clock.sleep_until(self._deadline_ns)
        now_ns = self.now_ns
        self.feedback = feedback = self._robot.receive(now_ns)
        if command is not None:
            self._robot.send(command, now_ns)
        for wheel in self.wheels:
            self._follow(wheel, feedback)
        return feedback

    def _follow(self, wheel: Wheel, feedback: Feedback) -> None:
        """Update a wheel with its newest position, which may roll over at 16 bits."""
        report = feedback.actuators[wheel.place]
        trail = wheel.trail
        if report.motion_ns <= trail[-1][0]:
            return
        known = self._known[wheel.place]
        self._known[wheel.place] = position = report.position_ticks
        if known is None:
            trail.clear()
        else:
            wheel.ticks += (position - known + 0x8000) % 0x10000 - 0x8000
        trail.append((report.motion_ns, wheel.ticks))
        while report.motion_ns - trail[0][0] > WINDOW_NS and len(trail) > 2:
            trail.popleft()

    def speed_rad_s(self, wheel: Wheel) -> float:
        """Return the reported speed of a wheel [rad/s]."""
        told = self.feedback.actuators[wheel.place].speed_rad_s
        return wheel.from_positions_rad_s if told is None else told

    # Nodes --------------------------------------------------------------------------------------

    @property
    def statuses(self) -> tuple[NodeStatus, ...]:
        """Status of each drive and node, proven or not."""
        return tuple(part.status for parts in self.parts.on_bus.values() for part in parts)

    @property
    def drives(self) -> tuple[tuple[MotorConfig, MotorDrive, tuple[Wheel, ...]], ...]:
        """Each drive with its table and its wheels."""
        return tuple(
            (motor, each.drive, tuple(wheel for wheel in self.wheels if wheel.place in each.places))
            for motor, each in zip(self.config.motors, self.parts.drives, strict=True)
        )

    def commission(self, seconds: float = COMMISSION_S) -> tuple[NodeStatus, ...]:
        """Wait until all drives and nodes are in service, at most for `seconds`."""
        end_ns = self.now_ns + round(seconds * 1e9)
        self.rest()
        while any(each.problem for each in self.statuses) and self.now_ns < end_ns:
            self.rest()
        return self.statuses

    def recover(self, seconds: float = 4.0) -> bool:
        """Clear the drives' latches; return whether all are ready."""
        end_ns = self.now_ns + round(seconds * 1e9)
        self.rest(0.1)
        while self.latched and self.now_ns < end_ns:
            self._robot.clear_faults()
            self.rest(0.2)
        return not self.latched

    @property
    def latched(self) -> str:
        """Reason why a drive is not ready; empty if all are."""
        for actuator, report in zip(self.actuators, self.feedback.actuators, strict=True):
            if report.fault is not None:
                return f"{actuator.drive}: {report.fault}"
            if report.state is not DriveState.READY:
                return f"{actuator.drive} is not ready ({report.state.name.lower()})"
        return ""

    # Motion -------------------------------------------------------------------------------------

    def spin(self, wheels: Sequence[Wheel], *, seconds: float = 0.0) -> Moved:
        """Turn wheels slowly forwards, then brake.

        Parameters
        ----------
        wheels
            Wheels to turn, by the present wiring.
        seconds
            Duration [s]; 0: until each has turned visibly.
        """
        moved = self.keep_spinning(wheels, seconds=seconds)
        self.rest(0.3)
        return moved

    def keep_spinning(self, wheels: Sequence[Wheel], *, seconds: float = 0.0) -> Moved:
        """Turn wheels slowly forwards, without a stop at the end."""
        self.rest(0.1)
        motion = _Motion(self, wheels)
        begin_ns = self.now_ns
        longest_s = seconds or TURN_S
        while (age_s := (self.now_ns - begin_ns) * 1e-9) < longest_s:
            self._tick(motion.command(self.period_ns * 1e-9))
            stopped = motion.objection(age_s) or ("you stopped it" if self._interrupts() else "")
            if stopped:
                self.rest()
                return Moved(motion.turned_rad, stopped)
            if not seconds and motion.least_turned_rad >= TURN_RAD:
                break
        return Moved(motion.turned_rad, "")


class _Motion:
    """A slow motion of some wheels, and its supervision."""

    def __init__(self, bench: Bench, wheels: Sequence[Wheel]) -> None:
        self._bench = bench
        self._wheels = wheels
        self._begun_rad = [wheel.angle_rad for wheel in bench.wheels]
        self._values = [0.0] * len(bench.actuators)

    @property
    def turned_rad(self) -> tuple[float, ...]:
        """Reported turn of each wheel [rad]."""
        wheels = self._bench.wheels
        return tuple(
            wheel.angle_rad - begun for wheel, begun in zip(wheels, self._begun_rad, strict=True)
        )

    @property
    def least_turned_rad(self) -> float:
        """Minimum reported turn of the wheels [rad]."""
        turned_rad = self.turned_rad
        return min(turned_rad[wheel.place] for wheel in self._wheels)

    def command(self, step_s: float) -> ActuatorCommand:
        """Return the command of the next tick."""
        for wheel in self._wheels:
            value, wanted = self._values[wheel.place], self._bench.slow_m_s / wheel.radius_m
            if wheel.actuator.takes is Takes.SPEED:
                value = min(value + wanted * step_s / RISE_S, wanted)
            else:
                slower = self._bench.speed_rad_s(wheel) < wanted
                value += DUTY_PER_S * step_s * (1.0 if slower else -1.0)
                value = min(max(value, 0.0), self._most_duty(wheel))
            self._values[wheel.place] = value
        return ActuatorCommand(True, True, tuple(self._values))

    def _most_duty(self, wheel: Wheel) -> float:
        """Return the duty whose voltage turns a free wheel at `MOST_M_S`.

        So it is slow even without a reported speed.
        """
        config = self._bench.config
        pwm = config.control.pwm
        told_v = self._bench.feedback.actuators[wheel.place].voltage_v
        supply_v = MAX_SUPPLY_V if told_v is None else max(told_v, pwm.min_bus_voltage_v)
        # Always present for such a wheel: see `robot_file`.
        back_emf_v_s_rad = config.plausibility.back_emf_v_s_rad or 0.0
        most_v = back_emf_v_s_rad * MOST_M_S / wheel.radius_m
        return min(pwm.deadband + most_v / supply_v, 1.0)

    def objection(self, age_s: float) -> str:
        """Return why the motion must end; empty: it may continue."""
        bench = self._bench
        for wheel, turned_rad in zip(bench.wheels, self.turned_rad, strict=True):
            report = bench.feedback.actuators[wheel.place]
            speed_m_s = wheel.radius_m * bench.speed_rad_s(wheel)
            if report.fault is not None:
                return f"{wheel.actuator.drive} reports: {report.fault.text}"
            if bench.now_ns - report.motion_ns > SILENT_NS:
                return f"{wheel.actuator.drive} says nothing about {wheel.name}"
            if abs(speed_m_s) > STOP_M_S:
                return (
                    f"{wheel.name} is reported at {speed_m_s:.2f} m/s, {bench.slow_m_s} commanded"
                )
            if wheel not in self._wheels and abs(turned_rad) > ASTRAY_RAD:
                names = ", ".join(each.name for each in self._wheels)
                return f"{names} was commanded, but {wheel.name} is reported to turn"
            if wheel in self._wheels and turned_rad < -ASTRAY_RAD:
                return f"{wheel.name} was commanded forwards, and is reported backwards"
            if age_s > 1.0 and report.state is not DriveState.ENABLED:
                return f"{wheel.actuator.drive} does not give power ({report.state.name.lower()})"
        return ""


def with_node_id(config: RobotConfig, motor: int, node_id: int) -> RobotConfig:
    """Return a robot with another node id of one drive, by its index.

    Raises
    ------
    InvalidValue
        If the node id is invalid.
    """
    motors = list(config.motors)
    motors[motor] = replace(motors[motor], node_id=node_id)  # type: ignore[type-var]
    return replace(config, motor=tuple(motors))
