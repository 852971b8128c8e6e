"""TIMESYNC: sends the robot's time on request."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer


class TimeSync(Microservice):
    """Answers TIMESYNC requests (tc1 = 0) with the robot's monotonic time."""

    handles = frozenset({common.MAVLINK_MSG_ID_TIMESYNC})

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Answer one request; answers to others are not ours."""
        if message.tc1 == 0:
            answer = common.MAVLink_timesync_message(now_ns, message.ts1)
            self._context.links.reply(answer, peer)
