"""HEARTBEAT: the robot's type, mode and state, once a second and at once when they change.

The robot claims to be an ArduPilot rover with its mode numbers, unless `[mavlink] personality` says
otherwise: that is what makes ground stations offer the functions of a rover.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.personality import Personality
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.mavlink_port import Message
from robotctl.safety.state_machine import ENABLED

INTERVAL_NS = 1_000_000_000
"""Interval of heartbeats [ns]."""

SILENT_NS: Final = 500_000_000
"""Silence of the control process after which the robot's state is unknown [ns]."""

MAV_STATES = {
    SafetyState.BOOT: common.MAV_STATE_BOOT,
    SafetyState.STANDBY: common.MAV_STATE_STANDBY,
    SafetyState.ARMED: common.MAV_STATE_ACTIVE,
    SafetyState.DRIVING: common.MAV_STATE_ACTIVE,
    SafetyState.MOTOR_TEST: common.MAV_STATE_ACTIVE,
    SafetyState.FAULT: common.MAV_STATE_CRITICAL,
    SafetyState.EMERGENCY_STOP: common.MAV_STATE_EMERGENCY,
}

MODE_FLAGS = {
    Mode.MANUAL: common.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
    Mode.HOLD: 0,
    Mode.AUTO: common.MAV_MODE_FLAG_GUIDED_ENABLED | common.MAV_MODE_FLAG_AUTO_ENABLED,
    Mode.RTL: common.MAV_MODE_FLAG_GUIDED_ENABLED | common.MAV_MODE_FLAG_AUTO_ENABLED,
    Mode.GUIDED: common.MAV_MODE_FLAG_GUIDED_ENABLED,
}


class Condition(NamedTuple):
    """Content of a HEARTBEAT: MAV_MODE_FLAG bits, mode, MAV_STATE."""

    flags: int
    mode: Mode
    state: int


class Heartbeat(Microservice):
    """Sends HEARTBEAT to all peers of all links."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._next_ns = 0
        self._told: Condition | None = None

    def streams(self) -> tuple[Stream, ...]:
        """Return HEARTBEAT, whose rate is fixed."""
        return (Stream(common.MAVLINK_MSG_ID_HEARTBEAT, self._build, None),)

    def step(self, now_ns: int) -> None:
        """Send when a second is over, or what is to be said has changed.

        A late step does not lead to a burst.
        """
        now = self.condition(now_ns)
        is_due = now_ns >= self._next_ns
        if is_due:
            following = self._next_ns + INTERVAL_NS
            self._next_ns = following if following > now_ns else now_ns + INTERVAL_NS
        if is_due or now != self._told:
            self._told = now
            self._context.links.broadcast(self._message(now))

    def _build(self, now_ns: int) -> list[Message]:
        return [self._message(self.condition(now_ns))]

    def _message(self, condition: Condition) -> Message:
        return heartbeat(condition, self._context.personality)

    def condition(self, now_ns: int) -> Condition:
        """Return the robot's present condition.

        Before the control process was heard the state is BOOT, after it fell silent CRITICAL and
        not armed: the motor controllers stop by themselves then.
        """
        control, mode = self._context.control, self._context.mode(now_ns)
        flags = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | MODE_FLAGS[mode]
        if control is None:
            return Condition(flags, mode, common.MAV_STATE_BOOT)
        if now_ns - control.stamp_ns > SILENT_NS:
            return Condition(flags, mode, common.MAV_STATE_CRITICAL)
        if control.state in ENABLED:
            flags |= common.MAV_MODE_FLAG_SAFETY_ARMED
        return Condition(flags, mode, MAV_STATES[control.state])


def heartbeat(condition: Condition, personality: Personality) -> Message:
    """Return a HEARTBEAT."""
    return common.MAVLink_heartbeat_message(
        common.MAV_TYPE_GROUND_ROVER,
        personality.autopilot,
        condition.flags,
        personality.modes[condition.mode],
        condition.state,
        3,  # mavlink_version, the value of both protocol versions
    )
