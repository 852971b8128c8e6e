"""MANUAL_CONTROL: the sticks of a ground station, with ArduRover's axes.

z (throttle) drives, positive forward, and y turns, positive to the right; x and r are ignored, as
ArduRover ignores them (`handle_manual_control_axes` in Rover/GCS_MAVLink_Rover.cpp). Of both axes
-1000 to 1000 is the whole travel and 0 is rest. An axis at 32767 is not given: as one at rest. A
throttle of 500 is half ahead, as on ArduRover, whatever lever a ground station shows for it.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.setpoints import SAY_AGAIN_NS
from robotctl.messages.control import ManualControl
from robotctl.messages.mavlink_port import Message, Peer

NO_AXIS = frames.INT16_MAX
FULL = 1000


class ManualControls(Microservice):
    """Turns sticks into requests that expire; `refused` counts messages out of range."""

    handles = frozenset({common.MAVLINK_MSG_ID_MANUAL_CONTROL})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._life_ns = context.setpoint_life_ns
        self.refused = 0
        self._say_ns = 0

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Take one position of the sticks; the message names its target in a field of its own."""
        if message.target not in (0, self._context.config.system_id):
            return
        throttle, steering = (0 if axis == NO_AXIS else axis for axis in (message.z, message.y))
        if max(abs(throttle), abs(steering)) > FULL:
            self.refused += 1
            if now_ns >= self._say_ns:
                self._say_ns = now_ns + SAY_AGAIN_NS
                found = f"z {message.z}, y {message.y}"
                self._context.say(now_ns, f"Sticks: {found}: allowed -{FULL} to {FULL}")
            return
        self._context.requests.append(
            ManualControl(
                now_ns,
                now_ns + self._life_ns,
                throttle / FULL,
                frames.stick_turn(steering),
            )
        )
