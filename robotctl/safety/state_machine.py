"""The safety state machine: one table of transitions, nothing moves outside it.

`FAULT` and `EMERGENCY_STOP` latch: they end only by a new request to arm, once their causes are
gone. The wheels turn only in `ARMED`, `DRIVING` and `MOTOR_TEST`.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import Fault


class Event(enum.Enum):
    """Events of the robot, in falling priority."""

    EMERGENCY_STOP = "emergency stop"
    FAULT = "fault"
    DISARM = "disarm"
    READY = "all nodes ready"
    NOT_READY = "a node is missing"
    ARM = "arm accepted"
    RESET = "arm asked for"
    MOVE = "velocity wanted"
    REST = "no velocity wanted, at rest"
    TEST = "motor test"
    TEST_OVER = "motor test over"


_S, _E = SafetyState, Event

TRANSITIONS: dict[tuple[SafetyState, Event], SafetyState] = {
    (_S.BOOT, _E.READY): _S.STANDBY,
    (_S.BOOT, _E.EMERGENCY_STOP): _S.EMERGENCY_STOP,
    (_S.STANDBY, _E.NOT_READY): _S.BOOT,
    (_S.STANDBY, _E.EMERGENCY_STOP): _S.EMERGENCY_STOP,
    (_S.STANDBY, _E.ARM): _S.ARMED,
    (_S.STANDBY, _E.TEST): _S.MOTOR_TEST,
    (_S.ARMED, _E.EMERGENCY_STOP): _S.EMERGENCY_STOP,
    (_S.ARMED, _E.FAULT): _S.FAULT,
    (_S.ARMED, _E.DISARM): _S.STANDBY,
    (_S.ARMED, _E.MOVE): _S.DRIVING,
    (_S.DRIVING, _E.EMERGENCY_STOP): _S.EMERGENCY_STOP,
    (_S.DRIVING, _E.FAULT): _S.FAULT,
    (_S.DRIVING, _E.DISARM): _S.STANDBY,
    (_S.DRIVING, _E.REST): _S.ARMED,
    (_S.FAULT, _E.EMERGENCY_STOP): _S.EMERGENCY_STOP,
    (_S.FAULT, _E.RESET): _S.STANDBY,
    (_S.EMERGENCY_STOP, _E.RESET): _S.STANDBY,
    (_S.MOTOR_TEST, _E.EMERGENCY_STOP): _S.EMERGENCY_STOP,
    (_S.MOTOR_TEST, _E.FAULT): _S.FAULT,
    (_S.MOTOR_TEST, _E.DISARM): _S.STANDBY,
    (_S.MOTOR_TEST, _E.TEST_OVER): _S.STANDBY,
}
"""Every transition there is; an event without a row in the present state changes nothing."""

POWERED = frozenset({SafetyState.ARMED, SafetyState.DRIVING})
"""States of an armed robot: it follows velocities."""

ENABLED = POWERED | {SafetyState.MOTOR_TEST}
"""States in which the motors may be enabled, and all is supervised."""

LATCHED = frozenset({SafetyState.FAULT, SafetyState.EMERGENCY_STOP})
"""States that only a new request to arm can leave."""


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """Maximum ages of inputs: an older input is not used.

    An age is counted from reception by the host's monotonic clock; an input from further in the
    future than its limit is as little trusted as an old one.

    Parameters
    ----------
    command_timeout_ms
        The motor controller stops after this time without a valid command [ms]; written to it and
        read back before arming. At least two control periods.
    feedback_timeout_periods
        The host stops when wheel feedback is older than this many control periods. Feedback whose
        encoder latch is that of the feedback before counts as none.
    status_timeout_ms
        As above for the motor controller's slower status frames [ms].
    battery_timeout_ms
        As above for the battery monitor [ms].
    sonar_timeout_ms
        As above for each sonar [ms]; an older range is not used. A sonar that reports no sensor or
        a fault of its own counts as silent.
    imu_timeout_ms
        As above for gyro and accelerometer, where the robot has them [ms].
    heartbeat_timeout_ms
        A node whose heartbeat is older is lost [ms].
    setpoint_timeout_ms
        A velocity set-point expires after this time [ms], even if its sender allows more.
    arm_timeout_ms
        A request to arm is refused if the robot does not become ready within this time [ms].
    request_max_age_ms
        Requests older than this are not carried out [ms].
    warmup_ticks
        Arming is refused before this many ticks of the loop: until then code paths are not
        specialised, pages not touched and the windows of the estimators not full.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    command_timeout_ms: int = 90
    feedback_timeout_periods: int = 3
    status_timeout_ms: int = 200
    battery_timeout_ms: int = 500
    sonar_timeout_ms: int = 250
    imu_timeout_ms: int = 100
    heartbeat_timeout_ms: int = 350
    setpoint_timeout_ms: int = 500
    arm_timeout_ms: int = 1000
    request_max_age_ms: int = 1000
    warmup_ticks: int = 100

    def __post_init__(self) -> None:
        """Check the ranges; the relation to the period is checked with the whole configuration."""
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise InvalidValue(name, f"must be {low} to {high}, not {value}", value)


_RANGES: Final = {
    "command_timeout_ms": (10, 1000),
    "feedback_timeout_periods": (2, 10),
    "status_timeout_ms": (1, 1000),
    "battery_timeout_ms": (1, 5000),
    "sonar_timeout_ms": (1, 1000),
    "imu_timeout_ms": (1, 1000),
    "heartbeat_timeout_ms": (1, 5000),
    "setpoint_timeout_ms": (1, 2000),
    "arm_timeout_ms": (1, 10_000),
    "request_max_age_ms": (1, 10_000),
    "warmup_ticks": (1, 10_000),
}
"""Allowed ranges of `SafetyConfig`: a limit that can be infinite is none."""


class SafetyMachine:
    """Holds the present state and why the robot is in it.

    Attributes
    ----------
    state
        The present state.
    powered
        Whether that is one of `ENABLED`.
    reason
        Reason, for the operator; empty if there is none.
    fault
        The same if it is a fault, otherwise None.
    """

    def __init__(self) -> None:
        self.state = SafetyState.BOOT
        self.powered = False
        self.explain("starting")

    def on(self, event: Event, why: Fault | str = "") -> bool:
        """Apply `event`; return whether the state changed. `why` is kept then."""
        new = TRANSITIONS.get((self.state, event))
        if new is None:
            return False
        self.state = new
        self.powered = new in ENABLED
        self.explain(why)
        return True

    def explain(self, why: Fault | str) -> None:
        """Keep why the robot is in the present state."""
        self.reason = str(why)
        self.fault = why if isinstance(why, Fault) else None
