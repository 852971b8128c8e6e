"""What the control core trusts: the newest of each input, its age, and why it would stop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from robotctl.runtime.messages import (
    BatteryFeedback,
    BusState,
    BusStatus,
    DriveFault,
    DriveState,
    DriveStatus,
    Feedback,
    MotorStatus,
    NodeStatus,
    SonarFeedback,
)
from robotctl.runtime.safety import SafetyConfig

BUS_LOAD_MAX: Final = 0.8
"""A fuller bus [1] delays what is least urgent, the node services, without bound."""

_NEVER_NS: Final = -(1 << 62)
_LATCHED_DRIVE_STATES = (DriveState.STOPPED, DriveState.FAULT, DriveState.EMERGENCY_STOP)
_DEAD_BUS_STATES = (BusState.BUS_OFF, BusState.DOWN)


class Health:
    """Keeps the newest inputs and judges them.

    Parameters
    ----------
    safety
        Age limits.
    period_ns
        Control period [ns], the unit of the wheel feedback's age limit.
    sonars
        Names of the sonars of the ring; empty where nobody uses any.
    """

    def __init__(self, safety: SafetyConfig, period_ns: int, sonars: tuple[str, ...] = ()) -> None:
        self.motor: MotorStatus | None = None
        self.drive: DriveStatus | None = None
        self.battery: BatteryFeedback | None = None
        self.nodes: tuple[NodeStatus, ...] = ()
        self.bus = BusStatus()
        self.sonar_m = [math.nan] * len(sonars)
        self.sonar_ns = [_NEVER_NS] * len(sonars)
        """Time of the last range that was one [ns]; a sonar's own fault does not count."""
        self._sonar_names = sonars
        self._wheels_ns = _NEVER_NS
        self._latch_us = -1
        self._wheels_limit_ns = safety.feedback_timeout_periods * period_ns
        self._status_limit_ns = safety.status_timeout_ms * 1_000_000
        self._battery_limit_ns = safety.battery_timeout_ms * 1_000_000
        self._sonar_limit_ns = safety.sonar_timeout_ms * 1_000_000
        self._heartbeat_limit_ns = safety.heartbeat_timeout_ms * 1_000_000

    def update(self, feedback: Feedback) -> None:
        """Take in what a tick brought."""
        wheels = feedback.wheels
        if wheels is not None and wheels.timestamp_us != self._latch_us:
            self._latch_us = wheels.timestamp_us
            self._wheels_ns = wheels.stamp_ns
        if feedback.motor is not None:
            self.motor = feedback.motor
        if feedback.drive is not None:
            self.drive = feedback.drive
        if feedback.battery is not None:
            self.battery = feedback.battery
        for sonar in feedback.sonars:
            self._take_sonar(sonar)
        self.nodes = feedback.nodes
        self.bus = feedback.bus

    def _take_sonar(self, sonar: SonarFeedback) -> None:
        """Keep the ranges of one group."""
        for index, range_m in enumerate(sonar.ranges_m, sonar.first):
            if index < len(self.sonar_m):
                self.sonar_m[index] = range_m
                if not math.isnan(range_m):
                    self.sonar_ns[index] = sonar.stamp_ns

    def fresh_sonar_m(self, now_ns: int) -> tuple[float, ...]:
        """Return the range of each sonar [m]; inf: no echo; nan: too old, or none at all."""
        limit_ns = self._sonar_limit_ns
        return tuple(
            range_m if is_fresh(stamp_ns, now_ns, limit_ns) else math.nan
            for range_m, stamp_ns in zip(self.sonar_m, self.sonar_ns, strict=True)
        )

    def fresh_motor(self, now_ns: int) -> MotorStatus | None:
        """Return the motor status if it is not too old."""
        motor = self.motor
        fresh = motor is not None and is_fresh(motor.stamp_ns, now_ns, self._status_limit_ns)
        return motor if fresh else None

    def fresh_drive(self, now_ns: int) -> DriveStatus | None:
        """Return the drive status if it is not too old."""
        drive = self.drive
        fresh = drive is not None and is_fresh(drive.stamp_ns, now_ns, self._status_limit_ns)
        return drive if fresh else None

    def fresh_battery(self, now_ns: int) -> BatteryFeedback | None:
        """Return the battery's report if it is not too old."""
        battery = self.battery
        fresh = battery is not None and is_fresh(battery.stamp_ns, now_ns, self._battery_limit_ns)
        return battery if fresh else None

    def node_problem(self, now_ns: int) -> str | None:
        """Return what keeps a node from service, or None when all are in service."""
        return next(self._node_problems(now_ns), None)

    def fault(self, now_ns: int) -> str | None:
        """Return why a powered robot must stop now, or None."""
        return next(self._faults(now_ns), None)

    def refusals(self, now_ns: int) -> tuple[str, ...]:
        """Return all reasons against arming at this moment, in the operator's words."""
        reasons = list(self._faults(now_ns))
        battery, bus = self.battery, self.bus
        if battery is not None and battery.low and not battery.critical:
            reasons.append(f"the battery is low ({battery.voltage_v:.1f} V)")
        if bus.state == BusState.ERROR_PASSIVE:
            reasons.append("the CAN bus is error passive")
        if bus.load > BUS_LOAD_MAX:
            reasons.append(f"the CAN bus is {bus.load:.0%} full, {BUS_LOAD_MAX:.0%} allowed")
        return tuple(reasons)

    def _faults(self, now_ns: int) -> Iterator[str]:
        """Yield each reason to stop, the most telling first."""
        if self.bus.state in _DEAD_BUS_STATES:
            yield f"the CAN bus is {_words(self.bus.state)}"
        if not is_fresh(self._wheels_ns, now_ns, self._wheels_limit_ns):
            yield f"wheel feedback is older than {self._wheels_limit_ns / 1e6:g} ms"
        motor, limit_ns = self.fresh_motor(now_ns), self._status_limit_ns
        if motor is None:
            yield f"motor status is older than {limit_ns / 1e6:g} ms"
        elif motor.state in _LATCHED_DRIVE_STATES:
            yield f"the motor controller is in {_words(motor.state)}{fault_words(motor.faults)}"
        if self.fresh_drive(now_ns) is None:
            yield f"drive status is older than {limit_ns / 1e6:g} ms"
        yield from self._battery_faults(now_ns)
        limit_ns = self._sonar_limit_ns
        for name, stamp_ns in zip(self._sonar_names, self.sonar_ns, strict=True):
            if not is_fresh(stamp_ns, now_ns, limit_ns):
                yield f"sonar {name} has given no range for {limit_ns / 1e6:g} ms"
        yield from self._node_problems(now_ns)

    def _battery_faults(self, now_ns: int) -> Iterator[str]:
        """Yield what is wrong with the battery."""
        battery = self.fresh_battery(now_ns)
        if self.battery is None:
            yield "the battery has not reported yet"
        elif battery is None:
            yield f"the battery's report is older than {self._battery_limit_ns / 1e6:g} ms"
        elif battery.critical:
            yield f"the battery is critical ({battery.voltage_v:.1f} V)"

    def _node_problems(self, now_ns: int) -> Iterator[str]:
        """Yield what keeps each node from service."""
        if not self.nodes:
            yield "no node has been heard on the bus"
        limit_ns = self._heartbeat_limit_ns
        for node in self.nodes:
            if node.problem:
                yield node.problem
            elif not is_fresh(node.heartbeat_ns, now_ns, limit_ns):
                yield f"{node.name} (node {node.node_id}): no heartbeat for {limit_ns / 1e6:g} ms"

    @property
    def drive_latched(self) -> bool:
        """Whether the motor controller waits for its faults to be cleared."""
        return self.motor is not None and self.motor.state in _LATCHED_DRIVE_STATES


def is_fresh(stamp_ns: int, now_ns: int, limit_ns: int) -> bool:
    """Return whether a stamp lies within `limit_ns` of now, the limit itself included [ns].

    A stamp from the future by more than that would never grow old, so it is not fresh either.
    """
    return -limit_ns <= now_ns - stamp_ns <= limit_ns


def fault_words(faults: int) -> str:
    """Return the motor controller's fault bits as `: over current, encoder`, or nothing."""
    names = [_words(fault) for fault in DriveFault if faults & fault]
    return f": {', '.join(names)}" if names else ""


def _words(value: DriveState | BusState | DriveFault) -> str:
    """Write an enum member for people."""
    return str(value.name).lower().replace("_", " ")
