"""Plausibility: consistency of the inputs with each other.

An input can be fresh, undamaged and wrong. Each monitor here compares inputs that come from
different sensors:

- encoder against duty and current. The voltage at a motor less the drop over its winding is its
  back-EMF, hence its speed, whatever its load: ``w = (u - R i) / k``. An encoder that disagrees is
  stuck, disconnected, reversed, swapped with its neighbour, or loses counts;
- current against motion. High current in one direction without matching speed: the wheel is
  blocked, or the robot pushes against something;
- wheel against wheel. Errors of supply, temperature and model are those of both wheels; what
  differs between them is one wheel's own;
- steering against its command, supply against battery, the drive's clock against the host's;
- sonar against odometry: `plausibility_sonar.py`; each sensor alone: `plausibility_values.py`.

Undetectable: a wheel and its motor both swapped with the other side's, if no sonar sees it; slip on
ice with no sonar echo ahead; tilt and being carried, since there is no IMU. No monitor leads to a
degraded mode: each stops the robot.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.actuators import Actuator, Takes
from robotctl.safety.clock_monitor import ClockMonitor
from robotctl.safety.duty_wheel_monitor import DutyWheelMonitor
from robotctl.safety.monitor import Monitored, MonitorInputs
from robotctl.safety.persistence import PersistenceTimer
from robotctl.safety.speed_wheel_monitor import SpeedWheelMonitor

JUMPS: Final = 3
"""Impossible jumps of a count within a second that make a fault: one glitch makes two."""

APART: Final = 1.5
"""Multiple of the tolerance by which both wheels with swapped encoders leave their commands."""

_SECOND_NS: Final = 1_000_000_000
_NOTHING: Final = ActuatorFeedback()


class Plausibility:
    """All monitors of wheels and joints.

    Parameters
    ----------
    robot
        The robot that is monitored.
    """

    def __init__(self, robot: Monitored) -> None:
        config, actuators = robot.plausibility, robot.actuators
        self._config = config
        self._deadband = robot.deadband
        self._actuators = actuators
        self._clocks = _clocks(actuators, config.clock_share)
        self._duty_wheels = {
            index: DutyWheelMonitor(each.name, config, robot.a_max_rad_s2)
            for index, each in _taking(Takes.DUTY, actuators)
        }
        wheels = tuple(self._duty_wheels.values())
        self._pairs = tuple(zip(wheels[::2], wheels[1::2], strict=False))
        self._speed_wheels = {
            index: SpeedWheelMonitor(each.name, config)
            for index, each in _taking(Takes.SPEED, actuators)
        }
        self.reset()

    def reset(self) -> None:
        """Reset: the robot is armed."""
        self.fault: Fault | None = None
        """The contradiction found; stays until `reset`."""
        for monitors in (self._clocks, self._duty_wheels, self._speed_wheels):
            for monitor in monitors.values():
                monitor.reset()
        self._joints = {i: PersistenceTimer() for i, _ in _taking(Takes.ANGLE, self._actuators)}
        self._apart = [PersistenceTimer() for _ in self._pairs]
        self._swapped = PersistenceTimer()
        self._seen: tuple[ActuatorFeedback, ...] = (_NOTHING,) * len(self._actuators)
        self._jumps = -1
        self._jumped_ns: deque[int] = deque(maxlen=JUMPS)

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick; return the first contradiction since the last `reset`."""
        reports, seen = inputs.feedback.actuators, self._seen
        if reports:
            self._seen = reports
            self._compare_clocks(reports, seen)
            if inputs.command.enable:
                if self._joints:
                    self._compare_joints(inputs, seen)
                if self._duty_wheels:
                    self._compare_duty_wheels(inputs, seen)
                if self._speed_wheels:
                    self._compare_speed_wheels(inputs, seen)
        return self.fault

    def _compare_clocks(
        self, reports: tuple[ActuatorFeedback, ...], seen: tuple[ActuatorFeedback, ...]
    ) -> None:
        """Compare the drives' clocks with the host's."""
        for index, clock in self._clocks.items():
            if reports[index].motion_ns != seen[index].motion_ns:
                self._say(clock.update(reports[index]))

    def _compare_joints(self, inputs: MonitorInputs, seen: tuple[ActuatorFeedback, ...]) -> None:
        """Compare the angles of joints with their commands."""
        config = self._config
        for index, astray in self._joints.items():
            report, wanted_rad = inputs.feedback.actuators[index], inputs.command.values[index]
            if report.motion_ns == seen[index].motion_ns or report.angle_rad is None:
                continue
            apart = abs(report.angle_rad - wanted_rad) > config.steering_tolerance_rad
            if astray.lasts_ns(apart, report.motion_ns) > config.steering_ms * 1_000_000:
                name = self._actuators[index].name
                text = (
                    f"the {name} is at {report.angle_rad:.2f} rad, commanded to "
                    f"{wanted_rad:.2f} rad"
                )
                self._say(Fault(FaultCode.STEERING_OFF, text))

    def _compare_duty_wheels(
        self, inputs: MonitorInputs, seen: tuple[ActuatorFeedback, ...]
    ) -> None:
        """Compare wheels that are driven by a duty with their motors, and with each other."""
        newest_ns, reports = 0, inputs.feedback.actuators
        for index, wheel in self._duty_wheels.items():
            report = reports[index]
            if report.report_ns == seen[index].report_ns or report.voltage_v is None:
                continue
            newest_ns = report.report_ns
            wheel.update(
                inputs.motion.speeds_rad_s[index],
                self._effective(inputs.command.values[index]) * report.voltage_v,
                math.nan if report.current_a is None else report.current_a,
                math.nan if report.temperature_c is None else report.temperature_c,
                newest_ns,
            )
        if newest_ns:
            self._check_jumps(inputs.motion.jumps, newest_ns)
            self._check_encoders(newest_ns)
            for wheel in self._duty_wheels.values():
                self._say(wheel.push_fault(newest_ns))

    def _compare_speed_wheels(
        self, inputs: MonitorInputs, seen: tuple[ActuatorFeedback, ...]
    ) -> None:
        """Compare wheels whose drives close the loop with their commands."""
        for index, wheel in self._speed_wheels.items():
            report = inputs.feedback.actuators[index]
            if report.motion_ns != seen[index].motion_ns:
                found = wheel.update(
                    inputs.command.values[index],
                    inputs.motion.speeds_rad_s[index],
                    inputs.motion.angles_rad[index],
                    report.motion_ns,
                )
                self._say(found)
        newest_ns = max(each.motion_ns for each in self._seen)
        self._check_swapped(newest_ns)
        self._check_jumps(inputs.motion.jumps, newest_ns)

    def _check_swapped(self, now_ns: int) -> None:
        """Report two loops that drive each other's wheel: one runs ahead, one backwards.

        A loop that sees the wrong wheel too slow accelerates its own, which the other loop sees too
        fast: they part, faster than one wheel alone runs away.
        """
        far = [each for each in self._speed_wheels.values() if abs(each.excess) > APART]
        parts = (
            len(far) == 2
            and far[0].excess * far[1].excess < 0.0
            and (far[0].is_against or far[1].is_against)
        )
        if self._swapped.lasts_ns(parts, now_ns) > 0:
            text = f"{far[0].name} and {far[1].name} encoders are swapped, or both reversed"
            self._say(Fault(FaultCode.ENCODERS_SWAPPED, text))

    def _effective(self, duty: float) -> float:
        """Return the share of the supply that a duty gives to the motor."""
        share = max(0.0, abs(duty) - self._deadband) / (1.0 - self._deadband)
        return math.copysign(share, duty)

    def _check_encoders(self, now_ns: int) -> None:
        """Report swapped encoders as such, otherwise each alone; then compare each pair."""
        # Before the single encoders, both of which would be reported as wrong.
        for one, other in self._pairs:
            if _exchanged(one, other):
                text = f"{one.name} and {other.name} encoders are swapped"
                self._say(Fault(FaultCode.ENCODERS_SWAPPED, text))
        for wheel in self._duty_wheels.values():
            self._say(wheel.encoder_fault())
        for (one, other), lasting in zip(self._pairs, self._apart, strict=True):
            # False for nan.
            apart = abs(one.ratio - other.ratio) > self._config.pair_share
            if lasting.lasts_ns(apart, now_ns) > self._config.pair_ms * 1_000_000:
                text = (
                    f"{one.name} and {other.name} wheel contradict each other: counted over "
                    f"electrical speed is {one.ratio:.2f} and {other.ratio:.2f}"
                )
                self._say(Fault(FaultCode.WHEELS_CONTRADICT, text))

    def _check_jumps(self, jumps: int, now_ns: int) -> None:
        """Look whether the last `JUMPS` impossible jumps came within a second."""
        if self._jumps >= 0:
            last_ns = self._jumped_ns
            last_ns.extend([now_ns] * min(jumps - self._jumps, JUMPS))
            if len(last_ns) == JUMPS and last_ns[-1] - last_ns[0] <= _SECOND_NS:
                text = f"encoder counts jump: {JUMPS} times within a second"
                self._say(Fault(FaultCode.ENCODER_JUMPS, text))
        self._jumps = jumps

    def _say(self, fault: Fault | None) -> None:
        """Keep the first fault."""
        self.fault = self.fault or fault


def _taking(takes: Takes, actuators: tuple[Actuator, ...]) -> list[tuple[int, Actuator]]:
    """Return the actuators that take such a command, with their places."""
    return [(index, each) for index, each in enumerate(actuators) if each.takes is takes]


def _clocks(actuators: tuple[Actuator, ...], share: float) -> dict[int, ClockMonitor]:
    """Return the monitor of each drive's clock by the place of its first wheel."""
    found: dict[str, int] = {}
    for index, each in enumerate(actuators):
        if each.abilities.stamps_positions and each.takes is not Takes.ANGLE:
            found.setdefault(each.drive, index)
    return {index: ClockMonitor(drive, share) for drive, index in found.items()}


def _exchanged(one: DutyWheelMonitor, other: DutyWheelMonitor) -> bool:
    """Return whether each wheel's count fits the other's motor, and not its own."""
    if not (one.is_off and other.is_off):
        return False
    # Each count matches the other side's motor: plugs swapped, not two faults.
    first = abs(one.electrical_rad_s - other.counted_rad_s) <= other.tolerance_rad_s
    return first and abs(other.electrical_rad_s - one.counted_rad_s) <= one.tolerance_rad_s
