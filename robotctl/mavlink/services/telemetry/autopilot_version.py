"""AUTOPILOT_VERSION, PROTOCOL_VERSION and the banner: identity, software and capabilities."""

from __future__ import annotations

import hashlib
from typing import ClassVar, Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.command import ACCEPTED, Command
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import Message

SEND_BANNER: Final = 42428
"""MAV_CMD_DO_SEND_BANNER of ArduPilot's dialect, with which Mission Planner begins."""


class AutopilotVersion(Microservice):
    """Sends the capabilities of all services, and the banner, on request."""

    commands = frozenset({SEND_BANNER})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_MAVLINK2

    def streams(self) -> tuple[Stream, ...]:
        """Return both messages, which have no rate."""
        return (
            Stream(common.MAVLINK_MSG_ID_AUTOPILOT_VERSION, self._version, None),
            Stream(additions.MAVLINK_MSG_ID_PROTOCOL_VERSION, self._protocol, None),
        )

    def on_command(self, command: Command, now_ns: int) -> int:  # noqa: ARG002
        """Send the banner: lines of text that name software and robot, on request."""
        robot = self._context.robot
        for line in (f"robotctl V{robot.version}", f"Robot {robot.name}"):
            self._context.tell_asker(now_ns, line, Severity.INFORMATION)
        return ACCEPTED

    def _version(self, now_ns: int) -> list[Message]:  # noqa: ARG002
        context = self._context
        capabilities = context.catalogue.capabilities | context.personality.capabilities
        return [autopilot_version(context.robot, capabilities)]

    def _protocol(self, now_ns: int) -> list[Message]:  # noqa: ARG002
        """Return PROTOCOL_VERSION: 200 is MAVLink 2.0."""
        hashes = [0] * 8, [0] * 8
        return [additions.MAVLink_protocol_version_message(200, 100, 200, *hashes)]


def autopilot_version(robot: TelemetryRobot, capabilities: int) -> Message:
    """Return AUTOPILOT_VERSION; the unique identifier is a hash of the robot's name."""
    digest = hashlib.sha256(robot.name.encode()).digest()
    return common.MAVLink_autopilot_version_message(
        capabilities,
        version_number(robot.version),
        0,
        0,
        0,
        [0] * 8,
        [0] * 8,
        [0] * 8,
        0,
        0,
        int.from_bytes(digest[:8], "little"),
    )


def version_number(version: str) -> int:
    """Return `major.minor.patch` as MAVLink writes it, marked as an official release."""
    parts = [int(part) if part.isdigit() else 0 for part in [*version.split("."), "0", "0"][:3]]
    major, minor, patch = (min(part, 255) for part in parts)
    return major << 24 | minor << 16 | patch << 8 | int(common.FIRMWARE_VERSION_TYPE_OFFICIAL)
