"""What the control core trusts: the newest of each input, its age, and why it would stop."""

from __future__ import annotations

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
)
from robotctl.runtime.safety import SafetyConfig

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
    """

    def __init__(self, safety: SafetyConfig, period_ns: int) -> None:
        self.motor: MotorStatus | None = None
        self.drive: DriveStatus | None = None
        self.battery: BatteryFeedback | None = None
        self.nodes: tuple[NodeStatus, ...] = ()
        self.bus = BusStatus()
        self._wheels_ns: int | None = None
        self._wheels_limit_ns = safety.feedback_timeout_periods * period_ns
        self._status_limit_ns = safety.status_timeout_ms * 1_000_000

    def update(self, feedback: Feedback) -> None:
        """Take in what a tick brought."""
        if feedback.wheels is not None:
            self._wheels_ns = feedback.wheels.stamp_ns
        if feedback.motor is not None:
            self.motor = feedback.motor
        if feedback.drive is not None:
            self.drive = feedback.drive
        if feedback.battery is not None:
            self.battery = feedback.battery
        self.nodes = feedback.nodes
        self.bus = feedback.bus

    def node_problem(self) -> str | None:
        """Return what keeps a node from service, or None when all are in service."""
        if not self.nodes:
            return "no node has been heard on the bus"
        for node in self.nodes:
            if node.problem:
                return node.problem
        return None

    def fault(self, now_ns: int) -> str | None:
        """Return why a powered robot must stop now, or None."""
        if self.bus.state in _DEAD_BUS_STATES:
            return f"the CAN bus is {_words(self.bus.state)}"
        if self._wheels_ns is None or now_ns - self._wheels_ns > self._wheels_limit_ns:
            return f"wheel feedback is older than {self._wheels_limit_ns / 1e6:g} ms"
        motor = self.motor
        if motor is None or now_ns - motor.stamp_ns > self._status_limit_ns:
            return f"motor status is older than {self._status_limit_ns / 1e6:g} ms"
        if motor.state in _LATCHED_DRIVE_STATES:
            return f"the motor controller is in {_words(motor.state)}{fault_words(motor.faults)}"
        if self.drive is None or now_ns - self.drive.stamp_ns > self._status_limit_ns:
            return f"drive status is older than {self._status_limit_ns / 1e6:g} ms"
        if self.battery is not None and self.battery.critical:
            return f"the battery is critical ({self.battery.voltage_v:.1f} V)"
        return self.node_problem()

    def refusals(self, now_ns: int) -> tuple[str, ...]:
        """Return all reasons against arming at this moment, in the operator's words."""
        reasons = []
        problem = self.fault(now_ns)
        if problem is not None:
            reasons.append(problem)
        if self.battery is None:
            reasons.append("the battery has not reported yet")
        elif self.battery.low:
            reasons.append(f"the battery is low ({self.battery.voltage_v:.1f} V)")
        if self.bus.state == BusState.ERROR_PASSIVE:
            reasons.append("the CAN bus is error passive")
        return tuple(reasons)

    @property
    def drive_latched(self) -> bool:
        """Whether the motor controller waits for its faults to be cleared."""
        return self.motor is not None and self.motor.state in _LATCHED_DRIVE_STATES


def fault_words(faults: int) -> str:
    """Return the motor controller's fault bits as `: over current, encoder`, or nothing."""
    names = [_words(fault) for fault in DriveFault if faults & fault]
    return f": {', '.join(names)}" if names else ""


def _words(value: DriveState | BusState | DriveFault) -> str:
    """Write an enum member for people."""
    return str(value.name).lower().replace("_", " ")
