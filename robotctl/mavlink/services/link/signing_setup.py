"""SETUP_SIGNING: a key for message signing, over links that the robot's file calls safe alone."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import Message, Peer

_NO_KEY: Final = bytes(32)


class SigningSetup(Microservice):
    """Takes a key; there is no answer in MAVLink but STATUSTEXT."""

    handles = frozenset({common.MAVLINK_MSG_ID_SETUP_SIGNING})

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a key, and say so."""
        context = self._context
        safe = {number for number, link in enumerate(context.config.link) if link.safe}
        if peer.link not in safe:
            context.say(now_ns, "Signing: a key is taken over a link with safe = true only")
            return
        key = bytes(message.secret_key)
        if key == _NO_KEY:
            context.say(now_ns, "Signing: it is switched off in the robot's file only")
            return
        refusal = context.take_key(key, message.initial_timestamp)
        if refusal:
            context.say(now_ns, f"Signing: the key is not taken: {refusal}")
        else:
            context.say(now_ns, "Signing: the key is taken", Severity.NOTICE)
