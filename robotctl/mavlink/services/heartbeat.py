"""HEARTBEAT: once a second, the robot's type, mode and state.

The robot claims to be an ArduPilot rover with its mode numbers, since that is what makes ground
stations offer the functions of a rover.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.mavlink_port import Message

INTERVAL_NS = 1_000_000_000

MAV_STATES = {
    SafetyState.BOOT: common.MAV_STATE_BOOT,
    SafetyState.STANDBY: common.MAV_STATE_STANDBY,
    SafetyState.ARMED: common.MAV_STATE_ACTIVE,
    SafetyState.DRIVING: common.MAV_STATE_ACTIVE,
    SafetyState.FAULT: common.MAV_STATE_CRITICAL,
    SafetyState.EMERGENCY_STOP: common.MAV_STATE_EMERGENCY,
}

ARMED_STATES = (SafetyState.ARMED, SafetyState.DRIVING)

MODE_FLAGS = {
    Mode.MANUAL: common.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
    Mode.HOLD: 0,
    Mode.AUTO: common.MAV_MODE_FLAG_GUIDED_ENABLED | common.MAV_MODE_FLAG_AUTO_ENABLED,
    Mode.RTL: common.MAV_MODE_FLAG_GUIDED_ENABLED | common.MAV_MODE_FLAG_AUTO_ENABLED,
    Mode.GUIDED: common.MAV_MODE_FLAG_GUIDED_ENABLED,
}


class Heartbeat(Microservice):
    """Sends HEARTBEAT to all peers of all links."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._next_ns = 0

    def streams(self) -> tuple[Stream, ...]:
        """Return HEARTBEAT, whose rate is fixed."""
        return (Stream(common.MAVLINK_MSG_ID_HEARTBEAT, self._build, None),)

    def step(self, now_ns: int) -> None:
        """Send when a second is over; a late step does not lead to a burst."""
        if now_ns >= self._next_ns:
            following = self._next_ns + INTERVAL_NS
            self._next_ns = following if following > now_ns else now_ns + INTERVAL_NS
            self._context.links.broadcast(self.message(now_ns))

    def _build(self, now_ns: int) -> list[Message]:
        return [self.message(now_ns)]

    def message(self, now_ns: int) -> Message:
        """Return the present HEARTBEAT.

        Before the control process was heard the state is BOOT, after it fell silent CRITICAL and
        not armed: the motor controllers stop by themselves then.
        """
        control = self._context.fresh_control(now_ns)
        mode = self._context.mode(now_ns)
        flags = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | MODE_FLAGS[mode]
        if control is not None:
            state = MAV_STATES[control.state]
            if control.state in ARMED_STATES:
                flags |= common.MAV_MODE_FLAG_SAFETY_ARMED
        elif self._context.control is None:
            state = common.MAV_STATE_BOOT
        else:
            state = common.MAV_STATE_CRITICAL
        return common.MAVLink_heartbeat_message(
            common.MAV_TYPE_GROUND_ROVER,
            common.MAV_AUTOPILOT_ARDUPILOTMEGA,
            flags,
            int(mode),
            state,
            3,  # mavlink_version, the value of both protocol versions
        )
