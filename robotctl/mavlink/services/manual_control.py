"""MANUAL_CONTROL: the sticks of a ground station.

x drives (positive forward); y or r turns, whichever is deflected more. Both are taken as positive
to the right: ground stations and autopilots do so for r too, and the definition was corrected to
it in 2025 (mavlink pull request 2398), though older dialect files say the opposite. An axis at
32767 is not given: as one at rest. z (throttle) is not used: some ground stations send 500 for a
stick at rest, which must not drive the robot.
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
        self._timeout_ns = round(context.config.setpoint_timeout_s * 1e9)
        self.refused = 0
        self._say_ns = 0

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Take one position of the sticks; the message names its target in a field of its own."""
        if message.target not in (0, self._context.config.system_id):
            return
        forward, *turns = (
            0 if axis == NO_AXIS else axis for axis in (message.x, message.y, message.r)
        )
        if any(abs(axis) > FULL for axis in (forward, *turns)):
            self.refused += 1
            if now_ns >= self._say_ns:
                self._say_ns = now_ns + SAY_AGAIN_NS
                found = f"x {message.x}, y {message.y}, r {message.r}"
                self._context.say(now_ns, f"Sticks: {found}: allowed -{FULL} to {FULL}")
            return
        turn = max(turns, key=abs)
        self._context.requests.append(
            ManualControl(
                now_ns, now_ns + self._timeout_ns, forward / FULL, frames.stick_turn(turn)
            )
        )
