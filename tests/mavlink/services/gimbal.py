"""A mount that turns a camera to where a ground station wants it: gimbal protocol, version 2."""

from __future__ import annotations

from typing import ClassVar

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.command import ACCEPTED, DENIED, Command
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer, source


class Gimbal(Microservice):
    """Takes angles as a command or as a message, and tells who commands."""

    handles = frozenset({common.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW})
    commands = frozenset({common.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_COMPONENT_IMPLEMENTS_GIMBAL_MANAGER

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._commander = (0, 0)

    def streams(self) -> tuple[Stream, ...]:
        """Return GIMBAL_MANAGER_STATUS at 5 Hz."""
        return (Stream(common.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS, self._status, 5.0),)

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take GIMBAL_MANAGER_SET_PITCHYAW; its sender is told at once who commands now."""
        self._commander = source(message)
        for status in self._status(now_ns):
            self._context.links.reply(status, peer)

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take DO_GIMBAL_MANAGER_PITCHYAW: param1 is the pitch [deg]."""
        if not -90.0 <= command.params[0] <= 90.0:
            self._context.say(now_ns, f"Gimbal: pitch {command.params[0]:g}: allowed -90 to 90")
            return DENIED
        self._commander = command.sender
        return ACCEPTED

    def _status(self, now_ns: int) -> list[Message]:
        return [
            common.MAVLink_gimbal_manager_status_message(
                frames.boot_ms(now_ns), 0, 1, *self._commander, 0, 0
            )
        ]
