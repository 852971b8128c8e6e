"""The control core's view of its inputs: the newest of each, its age, and reasons to stop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.messages.control import (
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
from robotctl.messages.faults import Fault, FaultCode

BUS_LOAD_MAX: Final = 0.8
"""Bus load above which the least urgent frames, the node services, are delayed without bound."""

_UNHEARD_NS: Final = 100_000_000
"""For this time after them, lost commands explain the wheels' motion: monitors use windows of 50
ms."""

_ENABLE_NS: Final = 100_000_000
"""Time for the drive to report enabled after arming: three commands and a status take 50 ms at 100
Hz; the rest allows for lost frames."""

_SILENCE: Final = frozenset({FaultCode.NODE_SILENT, FaultCode.DRIVE_STOPPED})
"""Faults that a stall of this process causes, besides those of age."""

_PAUSE_NS: Final = 250_000_000
"""Time after a stall during which it explains them: the motor controller reports one status
later."""

_NEVER_NS: Final = -(1 << 62)
_KEPT: Final = frozenset({"wheels", "motor", "drive", "battery", "sonars"})
"""Fields of `Feedback` that `Health` judges by more than their age."""
_LATCHED_DRIVE_STATES: Final = frozenset(
    {DriveState.STOPPED, DriveState.FAULT, DriveState.EMERGENCY_STOP}
)
_DEAD_BUS_STATES: Final = {
    BusState.BUS_OFF: FaultCode.BUS_OFF,
    BusState.DOWN: FaultCode.BUS_DOWN,
}
_LATCHED_CODES: Final = {
    DriveState.STOPPED: FaultCode.DRIVE_STOPPED,
    DriveState.EMERGENCY_STOP: FaultCode.DRIVE_EMERGENCY_STOP,
}
_DRIVE_FAULT_CODES: Final = {
    DriveFault.OVER_CURRENT: FaultCode.DRIVE_OVER_CURRENT,
    DriveFault.OVER_TEMPERATURE: FaultCode.DRIVE_OVER_TEMPERATURE,
    DriveFault.UNDER_VOLTAGE: FaultCode.DRIVE_UNDER_VOLTAGE,
    DriveFault.ENCODER: FaultCode.DRIVE_ENCODER,
    DriveFault.COMMAND_TIMEOUT: FaultCode.DRIVE_COMMAND_TIMEOUT,
    DriveFault.PARAMETER: FaultCode.DRIVE_PARAMETER,
}
_DRIVE: Final = "drive"
"""The node whose feedback has no other name."""


class AgeLimit(NamedTuple):
    """Maximum age of a node's reports.

    Parameters
    ----------
    field
        Of `Feedback`.
    code
        Of the fault where it is older.
    words
        Begin the sentence for people, before "older than"; of sonars, before the limit.
    part
        Node concerned; empty if it concerns no single one.
    limit_ns
        Greatest age [ns].
    """

    field: str
    code: FaultCode
    words: str
    part: str
    limit_ns: int

    def fault(self) -> Fault:
        """Return the fault of a value that is older."""
        text = f"{self.words} older than {self.limit_ns / 1e6:g} ms"
        return Fault(self.code, text, self.part)


class Health:
    """Keeps the newest inputs and judges them.

    Parameters
    ----------
    ages
        How old what the nodes report may be: at least wheels, motor, drive and battery.
    heartbeat_limit_ns
        How old a node's heartbeat may be [ns].
    sonars
        Names of the sonars of the ring; empty if none is used.
    """

    def __init__(
        self, ages: tuple[AgeLimit, ...], heartbeat_limit_ns: int, sonars: tuple[str, ...] = ()
    ) -> None:
        self._ages = {age.field: age for age in ages}
        self._silence = _SILENCE | {age.code for age in ages}
        """Faults that a pause of this process brings about."""
        self._others = [age for age in ages if age.field not in _KEPT]
        """Inputs judged by age alone,"""
        self._others_ns = dict.fromkeys((age.field for age in self._others), _NEVER_NS)
        """and when the newest of each came [ns]."""
        self.motor: MotorStatus | None = None
        self._motor_fault: Fault | None = None
        """What `motor` reports."""
        self.drive: DriveStatus | None = None
        self._command_loss: DriveStatus | None = None
        """The last status that reported an old newest valid command."""
        self._idle_ns = -_NEVER_NS
        """When the drive was last enabled, or not commanded to be [ns]."""
        self.battery: BatteryFeedback | None = None
        self._take_nodes(())
        self.bus = BusStatus()
        self._bus_fault: Fault | None = None
        self.sonar_m = [math.nan] * len(sonars)
        self.sonar_ns = [_NEVER_NS] * len(sonars)
        """Time of the last range that was one [ns]; a sonar's own fault does not count."""
        self._sonar_names = sonars
        self._sonars_ns = span_ns(self.sonar_ns)
        self._wheels_ns = _NEVER_NS
        self._latch_us = -1
        self._wheels_limit_ns = self._ages["wheels"].limit_ns
        self._motor_limit_ns = self._ages["motor"].limit_ns
        self._drive_limit_ns = self._ages["drive"].limit_ns
        self._battery_limit_ns = self._ages["battery"].limit_ns
        self._sonar_limit_ns = self._ages["sonars"].limit_ns if sonars else 0
        self._heartbeat_limit_ns = heartbeat_limit_ns
        self._stepped_ns: int | None = None
        self._paused_ns = 0
        self._pause_over_ns = _NEVER_NS

    def update(self, feedback: Feedback) -> None:
        """Take the inputs of one tick."""
        wheels = feedback.wheels
        # The same latch again is no new measurement, however recent its frame.
        if wheels is not None and wheels.timestamp_us != self._latch_us:
            self._latch_us = wheels.timestamp_us
            self._wheels_ns = wheels.stamp_ns
        if feedback.motor is not None:
            self.motor = feedback.motor
            self._motor_fault = _motor_fault(feedback.motor)
            if feedback.motor.state is DriveState.ENABLED:
                self._idle_ns = feedback.motor.stamp_ns
        if feedback.drive is not None:
            self.drive = feedback.drive
            if feedback.drive.command_age_ms * 1_000_000 > self._wheels_limit_ns:
                self._command_loss = feedback.drive
        if feedback.battery is not None:
            self.battery = feedback.battery
        if feedback.sonars:
            self._take_sonars(feedback.sonars)
        if self._others:
            self._take_others(feedback)
        if feedback.nodes is not self.nodes:
            self._take_nodes(feedback.nodes)
        self._take_bus(feedback.bus)

    def step(self, now_ns: int) -> None:
        """Note the time of this step, and whether this process was held up since the last one.

        A stalled process sends neither commands nor SYNC, so it causes the missing inputs itself.
        """
        before_ns, self._stepped_ns = self._stepped_ns, now_ns
        if before_ns is not None and now_ns - before_ns > self._wheels_limit_ns:
            self._paused_ns, self._pause_over_ns = now_ns - before_ns, now_ns

    def _take_others(self, feedback: Feedback) -> None:
        """Note when the inputs judged by age alone last arrived."""
        for age in self._others:
            value = getattr(feedback, age.field)
            if value is not None:
                self._others_ns[age.field] = value.stamp_ns

    def _take_sonars(self, sonars: tuple[SonarFeedback, ...]) -> None:
        """Keep the ranges of some groups."""
        for sonar in sonars:
            for index, range_m in enumerate(sonar.ranges_m, sonar.first):
                if index < len(self.sonar_m):
                    self.sonar_m[index] = range_m
                    # A missing measurement does not renew the age of the last one.
                    if not math.isnan(range_m):
                        self.sonar_ns[index] = sonar.stamp_ns
        self._sonars_ns = span_ns(self.sonar_ns)

    def _take_bus(self, bus: BusStatus) -> None:
        """Keep the state of the bus, and the fault that it is."""
        if bus is self.bus:
            return
        self.bus = bus
        code = _DEAD_BUS_STATES.get(bus.state)
        self._bus_fault = None
        if code is not None:
            self._bus_fault = Fault(code, f"the CAN bus is {_words(bus.state)}")

    def _take_nodes(self, nodes: tuple[NodeStatus, ...]) -> None:
        """Store the nodes' state, which changes only with their heartbeats."""
        self.nodes = nodes
        self._heartbeats_ns = span_ns([node.heartbeat_ns for node in nodes])
        # There are some, and none has a problem but perhaps its age.
        self._in_service = bool(nodes) and not any(node.problem for node in nodes)

    def wheels_fresh(self, now_ns: int) -> bool:
        """Return whether the newest wheel feedback is not too old."""
        return is_fresh(self._wheels_ns, now_ns, self._wheels_limit_ns)

    def is_fresh(self, field: str, now_ns: int) -> bool:
        """Return whether inputs judged by age alone have arrived and are fresh."""
        stamp_ns = self._others_ns.get(field)
        return stamp_ns is not None and is_fresh(stamp_ns, now_ns, self._ages[field].limit_ns)

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
        fresh = motor is not None and is_fresh(motor.stamp_ns, now_ns, self._motor_limit_ns)
        return motor if fresh else None

    def fresh_drive(self, now_ns: int) -> DriveStatus | None:
        """Return the drive status if it is not too old."""
        drive = self.drive
        fresh = drive is not None and is_fresh(drive.stamp_ns, now_ns, self._drive_limit_ns)
        return drive if fresh else None

    def fresh_battery(self, now_ns: int) -> BatteryFeedback | None:
        """Return the battery's report if it is not too old."""
        battery = self.battery
        fresh = battery is not None and is_fresh(battery.stamp_ns, now_ns, self._battery_limit_ns)
        return battery if fresh else None

    def command_loss(self, now_ns: int) -> Fault | None:
        """Return a fault if the motor controller reports that no command reached it."""
        drive = self._command_loss
        if drive is None or now_ns - drive.stamp_ns > _UNHEARD_NS:
            return None
        return Fault(FaultCode.COMMAND_LOSS, _command_loss_text(drive), _DRIVE)

    def node_problem(self, now_ns: int) -> Fault | None:
        """Return the fault that keeps a node out of service, or None if all are in service."""
        problems = self._node_problems(now_ns)
        return problems[0] if problems else None

    def fault(self, now_ns: int) -> Fault | None:
        """Return why a powered robot must stop now, or None."""
        faults = self._faults(now_ns)
        if faults:
            return self._explained(faults[0], now_ns)
        motor = self.motor
        if motor is None or motor.stamp_ns - self._idle_ns <= _ENABLE_NS:
            return None
        stays = f"the motor controller stays in {_words(motor.state)} although commanded to drive"
        return self.command_loss(now_ns) or Fault(FaultCode.DRIVE_NOT_ENABLED, stays, _DRIVE)

    def _explained(self, fault: Fault, now_ns: int) -> Fault:
        """Return a fault, or that this process was held up where this explains it."""
        if now_ns - self._pause_over_ns > _PAUSE_NS or fault.code not in self._silence:
            return fault
        text = f"control was held up for {self._paused_ns / 1e6:.0f} ms: {fault}"
        return Fault(FaultCode.CONTROL_HELD_UP, text)

    def armed(self, now_ns: int) -> None:
        """Take note that the robot is armed: from now on the drive is to be enabled."""
        self._idle_ns = now_ns

    def refusals(self, now_ns: int) -> tuple[Fault, ...]:
        """Return all reasons against arming at this moment."""
        reasons = self._faults(now_ns)
        drive, battery, bus = self.fresh_drive(now_ns), self.battery, self.bus
        if drive is not None and drive is self._command_loss:
            reasons.append(Fault(FaultCode.COMMAND_LOSS, _command_loss_text(drive), _DRIVE))
        # The reasons below prevent arming but do not stop a robot that already drives.
        if battery is not None and battery.low and not battery.critical:
            text = f"the battery is low ({battery.voltage_v:.1f} V)"
            reasons.append(Fault(FaultCode.BATTERY_LOW, text))
        if bus.state == BusState.ERROR_PASSIVE:
            reasons.append(Fault(FaultCode.BUS_PASSIVE, "the CAN bus is error passive"))
        if bus.load > BUS_LOAD_MAX:
            text = f"the CAN bus is {bus.load:.0%} full, {BUS_LOAD_MAX:.0%} allowed"
            reasons.append(Fault(FaultCode.BUS_FULL, text))
        return tuple(reasons)

    def _faults(self, now_ns: int) -> list[Fault]:
        """Return all reasons to stop, the most telling first."""
        faults = []
        if self._bus_fault is not None:
            faults.append(self._bus_fault)
        ages = self._ages
        if not self.wheels_fresh(now_ns):
            faults.append(ages["wheels"].fault())
        if self.fresh_motor(now_ns) is None:
            faults.append(ages["motor"].fault())
        elif self._motor_fault is not None:
            faults.append(self._motor_fault)
        if self.fresh_drive(now_ns) is None:
            faults.append(ages["drive"].fault())
        faults += self._battery_faults(now_ns)
        faults += self._sonar_faults(now_ns)
        for age in self._others:
            if not is_fresh(self._others_ns[age.field], now_ns, age.limit_ns):
                faults.append(age.fault())
        faults += self._node_problems(now_ns)
        return faults

    def _battery_faults(self, now_ns: int) -> list[Fault]:
        """Return the battery's faults."""
        battery = self.battery
        if battery is None:
            return [Fault(FaultCode.BATTERY_MISSING, "the battery has not reported yet")]
        if not is_fresh(battery.stamp_ns, now_ns, self._battery_limit_ns):
            return [self._ages["battery"].fault()]
        if battery.critical:
            text = f"the battery is critical ({battery.voltage_v:.1f} V)"
            return [Fault(FaultCode.BATTERY_CRITICAL, text)]
        return []

    def _sonar_faults(self, now_ns: int) -> list[Fault]:
        """Return which sonars have been silent for too long."""
        limit_ns = self._sonar_limit_ns
        if are_fresh(self._sonars_ns, now_ns, limit_ns):
            return []
        age = self._ages["sonars"]
        silence = f"{age.words} {limit_ns / 1e6:g} ms"
        return [
            Fault(age.code, f"sonar {name} {silence}", name)
            for name, stamp_ns in zip(self._sonar_names, self.sonar_ns, strict=True)
            if not is_fresh(stamp_ns, now_ns, limit_ns)
        ]

    def _node_problems(self, now_ns: int) -> list[Fault]:
        """Return the faults that keep nodes out of service."""
        limit_ns = self._heartbeat_limit_ns
        if self._in_service and are_fresh(self._heartbeats_ns, now_ns, limit_ns):
            return []
        problems = []
        if not self.nodes:
            text = "no heartbeat from any node on the bus"
            problems.append(Fault(FaultCode.NODE_NOT_HEARD, text))
        for node in self.nodes:
            if node.problem:
                problems.append(Fault(node.fault, node.problem, node.name))
            elif not is_fresh(node.heartbeat_ns, now_ns, limit_ns):
                silence = f"no heartbeat for {limit_ns / 1e6:g} ms"
                text = f"{node.name} (node {node.node_id}): {silence}"
                problems.append(Fault(FaultCode.NODE_SILENT, text, node.name))
        return problems

    @property
    def drive_latched(self) -> bool:
        """Whether the motor controller waits for its faults to be cleared."""
        return self.motor is not None and self.motor.state in _LATCHED_DRIVE_STATES


def is_fresh(stamp_ns: int, now_ns: int, limit_ns: int) -> bool:
    """Return whether a stamp is within `limit_ns` of now, inclusive [ns].

    A stamp from the future by more than that would never grow old, so it is not fresh either.
    """
    return -limit_ns <= now_ns - stamp_ns <= limit_ns


def span_ns(stamps_ns: Sequence[int]) -> tuple[int, int]:
    """Return the oldest and the newest stamp [ns]; of none, what is fresh at any time."""
    return min(stamps_ns, default=-_NEVER_NS), max(stamps_ns, default=_NEVER_NS)


def are_fresh(span: tuple[int, int], now_ns: int, limit_ns: int) -> bool:
    """Return whether all stamps of a `span_ns` are fresh: the oldest and the newest are [ns]."""
    oldest_ns, newest_ns = span
    return newest_ns - limit_ns <= now_ns <= oldest_ns + limit_ns


def fault_words(faults: int) -> str:
    """Return the motor controller's fault bits as `: over current, encoder`, or nothing."""
    names = [_words(fault) for fault in DriveFault if faults & fault]
    return f": {', '.join(names)}" if names else ""


def _motor_fault(motor: MotorStatus) -> Fault | None:
    """Return the fault of a motor controller that has stopped or reports one, else None.

    Its code is that of the first fault bit, as in the text, except for a reported stop.
    """
    latched = motor.state in _LATCHED_DRIVE_STATES
    if not (latched or motor.faults):
        return None
    bits = [code for bit, code in _DRIVE_FAULT_CODES.items() if motor.faults & bit]
    first = bits[0] if bits else FaultCode.DRIVE_FAULT
    words = fault_words(motor.faults)
    if not latched:
        return Fault(first, f"the motor controller reports{words}", _DRIVE)
    code = _LATCHED_CODES.get(motor.state, first)
    return Fault(code, f"the motor controller is in {_words(motor.state)}{words}", _DRIVE)


def _command_loss_text(drive: DriveStatus) -> str:
    """Return the text on how long the motor controller received nothing."""
    return f"the motor controller had no valid command for {drive.command_age_ms} ms"


def _words(value: DriveState | BusState | DriveFault) -> str:
    """Write an enum member for people."""
    return str(value.name).lower().replace("_", " ")
