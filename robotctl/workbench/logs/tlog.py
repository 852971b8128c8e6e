"""A recording as a telemetry log of ground stations: what the robot would have sent them.

The messages go through the same services as on the robot, at the configured rates of its default,
to one ground station that only listens.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, Final

from pymavlink.dialects.v20 import common

import robotctl
from robotctl.drivers.mavlink.tlog import tlog_entry
from robotctl.logs.mcap.restored import Restored
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.mavlink_port import LinkStatus, Message, Peer, Received
from robotctl.runtime.storage.atomic_file import part_file
from robotctl.workbench.logs.messages import Timed, messages_of, peek, sonars_of
from robotctl.workbench.logs.rows import RecordingError, log_files

STEP_NS: Final = 10_000_000
"""Period of telemetry, as that of its process [ns]."""
PAUSE_NS: Final = 5_000_000_000
"""Longest time without a state over which telemetry goes on [ns]."""
CONFIG: Final = MavlinkConfig()
"""Address and rates."""
_FIRST: Final = 2_000
"""Messages that show what the robot has."""
_LISTENER: Final = Peer(0, 0)


class ListeningStation:
    """`MavlinkPort` whose only peer writes down what it gets.

    Attributes
    ----------
    frames
        How many.
    wall_ns
        Time of what is sent now [ns since 1970].
    """

    count = 1

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._codec = common.MAVLink(None, CONFIG.system_id, CONFIG.component_id)
        self.frames = 0
        self.wall_ns = 0

    def poll(self, now_ns: int, timeout_s: float = 0.0) -> list[Received]:  # noqa: ARG002
        """Return nothing: it does not speak."""
        return []

    def peers(self) -> tuple[Peer, ...]:
        """Return the one peer."""
        return (_LISTENER,)

    def broadcast(self, message: Message, peers: Collection[Peer] | None = None) -> None:
        """Write a message down if it is for the peer."""
        if peers is None or _LISTENER in peers:
            self.reply(message, _LISTENER)

    def reply(self, message: Message, peer: Peer) -> None:  # noqa: ARG002
        """Write a message down."""
        frame = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        self._file.write(tlog_entry(self.wall_ns, frame))
        self.frames += 1

    def forward(self, message: Message, peers: Collection[Peer]) -> None:
        """Have nothing to forward."""

    def flush(self) -> None:
        """Have nothing that waits."""

    def status(self) -> tuple[LinkStatus, ...]:
        """Return no counters."""
        return ()

    def close(self) -> None:
        """Have nothing to release."""


def export_tlog(run: Path, target: Path) -> tuple[int, list[str]]:
    """Write a recording as a telemetry log; return its frames, and what could not be read.

    Raises
    ------
    RecordingError
        If it is no recording, or has no states.
    OSError
        If a file cannot be read or written.
    """
    files = log_files(run)
    notes: list[str] = []
    first, messages = peek(messages_of(files, notes), _FIRST)
    states = [each.message for each in first if isinstance(each.message, ControlState)]
    if not states:
        raise RecordingError(f"{run}: no state of the robot is in it")
    robot = TelemetryRobot(
        version=robotctl.__version__,
        sonars=sonars_of(files),
        has_imu=any(each.imu is not None for each in states),
        has_localiser=any(isinstance(each.message, LocalisationState) for each in first),
    )
    with part_file(target) as file:
        station = ListeningStation(file)
        _send(messages, robot, station)
    return station.frames, notes


def _send(messages: Iterator[Timed], robot: TelemetryRobot, station: ListeningStation) -> None:
    """Let telemetry send what it makes of the messages, step by step from state to state."""
    telemetry: Telemetry | None = None
    epoch_ns = step_ns = 0
    waiting: list[Restored] = []
    for each in messages:
        stamp_ns = each.message.stamp_ns
        if isinstance(each.message, ControlState):
            is_later = each.epoch_ns == epoch_ns and step_ns - STEP_NS <= stamp_ns
            if telemetry is None or not is_later:  # another run
                telemetry = Telemetry(CONFIG, robot, station, wall_ns=lambda: station.wall_ns)
                step_ns = stamp_ns
            step_ns = max(step_ns, stamp_ns - PAUSE_NS)
            epoch_ns = each.epoch_ns
            while step_ns < stamp_ns:
                step_ns += STEP_NS
                station.wall_ns = step_ns + epoch_ns
                telemetry.step(step_ns, waiting)
                waiting.clear()
        waiting.append(each.message)
    if telemetry is not None:
        step_ns += STEP_NS
        station.wall_ns = step_ns + epoch_ns
        telemetry.step(step_ns, waiting)
