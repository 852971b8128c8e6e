"""The continuous log: what the processes publish, as MCAP with JSON messages.

Topics are `control`, `navigation`, `localisation`, `lidar`, `camera` and `notice`; see
docs/logs.md. A chunk ends at each `flush`, so that a file cut anywhere holds all that came before
its last flush. Such a file has no index: strict readers want it recovered first.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias

import msgspec
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC, Writer

import robotctl
from robotctl.errors import RobotctlError
from robotctl.runtime.estimation_messages import CameraView, LidarScan, LocalisationState
from robotctl.runtime.messages import ControlState, NavigationState, Notice
from robotctl.runtime.part_file import part_file
from robotctl.runtime.ring_file import hold
from robotctl.telemetry.log_schema import (
    LASER_SCHEMA,
    LOG_SCHEMA,
    laser_scan,
    log_entry,
    plain,
    schema_of,
)

Published: TypeAlias = (
    ControlState | NavigationState | LocalisationState | LidarScan | CameraView | Notice
)

_DAMAGE: Final = (McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, EOFError)
_RECORD_LIMIT: Final = 1 << 28


class McapLogError(RobotctlError):
    """A log is no MCAP file."""


class LogInUseError(McapLogError):
    """A log is still being written."""


class McapLog:
    """Writes published messages to an MCAP file.

    Parameters
    ----------
    file
        Open for writing in binary mode, empty; left open by `close`.
    epoch_ns
        Added to the stamps of messages to get wall time [ns].
    name
        Of the robot.
    """

    def __init__(self, file: BinaryIO, epoch_ns: int, name: str) -> None:
        self._writer = Writer(file)
        self._writer.start(library=f"robotctl {robotctl.__version__}")
        self._epoch_ns = epoch_ns
        self._name = name
        self._encode = msgspec.json.Encoder().encode
        self._channels: dict[type, int] = {
            ControlState: self._channel("control", "ControlState", schema_of(ControlState)),
            NavigationState: self._channel(
                "navigation", "NavigationState", schema_of(NavigationState)
            ),
            LocalisationState: self._channel(
                "localisation", "LocalisationState", schema_of(LocalisationState)
            ),
            CameraView: self._channel("camera", "CameraView", schema_of(CameraView)),
            LidarScan: self._channel("lidar", "foxglove.LaserScan", LASER_SCHEMA),
            Notice: self._channel("notice", "foxglove.Log", LOG_SCHEMA),
        }

    def _channel(self, topic: str, name: str, schema: dict[str, object]) -> int:
        """Register a topic."""
        schema_id = self._writer.register_schema(
            name, SchemaEncoding.JSONSchema, self._encode({"title": name, **schema})
        )
        return self._writer.register_channel(topic, MessageEncoding.JSON, schema_id)

    def add(self, message: Published) -> None:
        """Add a message at its stamp."""
        time_ns = message.stamp_ns + self._epoch_ns
        if isinstance(message, Notice):
            content = log_entry(time_ns, message.severity, message.text, self._name)
        elif isinstance(message, LidarScan):
            content = laser_scan(time_ns, message)
        else:
            content = plain(message)
        self._writer.add_message(
            self._channels[type(message)], time_ns, self._encode(content), time_ns
        )

    def flush(self) -> None:
        """Hand all that was added to the kernel, where a kill does not reach it."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index; the file is complete then."""
        self._writer.finish()


def is_complete(path: Path) -> bool:
    """Return whether a log was closed in order."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > 2 * len(MCAP0_MAGIC) and file.read() == MCAP0_MAGIC


def recover(path: Path) -> int:
    """Make a log that was cut complete, up to its last whole chunk; return its messages.

    The file is replaced when the whole one is on the disk; until then that is `NAME.mcap.part`.

    Raises
    ------
    LogInUseError
        If a living process writes it; it stays as it is.
    McapLogError
        If it is no MCAP file; it stays as it is.
    OSError
        If it cannot be read or written.
    """
    with path.open("rb") as source:
        if not hold(source):
            raise LogInUseError(f"{path}: is still being written; whoever writes it completes it")
        if source.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise McapLogError(f"{path}: not an MCAP file")
        source.seek(0)
        with part_file(path) as file:
            return _copy(source, file)


def whole_records(source: BinaryIO) -> Iterator[McapRecord | None]:
    """Yield the records of a log; at last None if it was cut or damaged there."""
    records = StreamReader(
        source, validate_crcs=True, record_size_limit=_RECORD_LIMIT
    ).records  # fmt: skip
    while True:
        try:
            yield next(records)
        except StopIteration:
            return
        except _DAMAGE:
            yield None
            return


def _copy(source: BinaryIO, target: BinaryIO) -> int:
    """Copy whole records; return how many messages."""
    writer = Writer(target)
    writer.start(library=f"robotctl {robotctl.__version__}")
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    count = 0
    for record in whole_records(source):
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Message):
            writer.add_message(
                channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
            count += 1
    writer.finish()
    return count
