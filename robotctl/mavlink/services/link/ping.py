"""PING: comes back to who has sent it."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer, source


class Ping(Microservice):
    """Answers requests, which have no target; a PING with one is the answer of another."""

    handles = frozenset({common.MAVLINK_MSG_ID_PING})

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Answer one request."""
        if message.target_system == 0 and message.target_component == 0:
            answer = common.MAVLink_ping_message(message.time_usec, message.seq, *source(message))
            self._context.links.reply(answer, peer)
