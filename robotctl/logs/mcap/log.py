"""The continuous log: the processes' messages, as MCAP with JSON.

docs/logs.md lists its topics. A chunk ends at each `flush`, so that a file cut anywhere holds all
that came before its last flush. Such a file has no index: strict readers want it recovered first.
"""

from __future__ import annotations

import io
import os
import stat
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Header, McapRecord, Message, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC, Writer

import robotctl
from robotctl.errors import RobotctlError
from robotctl.logs.mcap.entries import TOPICS, Entry, LogEntries, Published
from robotctl.logs.mcap.records import Gap, whole_records
from robotctl.logs.mcap.scene import Scene
from robotctl.logs.mcap.schema import JsonSchema
from robotctl.messages.control import Notice
from robotctl.runtime.storage.atomic_file import part_file
from robotctl.runtime.storage.ring_file import hold
from robotctl.runtime.storage.state_file import damaged_name

_FOOTER: Final = struct.Struct("<BQQQI")
"""Kind and length; where the index begins, and its offsets; CRC-32 of all up to itself, or 0."""

_LIBRARY: Final = f"robotctl {robotctl.__version__}"


class McapLogError(RobotctlError):
    """A log is no MCAP file."""


class LogInUseError(McapLogError):
    """A log is still being written."""


class McapLog:
    """Writes published messages to an MCAP file, and the frames that a viewer needs to show them.

    Parameters
    ----------
    file
        Open for writing in binary mode, empty; left open by `close`.
    epoch_ns
        Added to the stamps of messages to get wall time [ns].
    name
        Of the robot.
    scene
        Common data of all files of a run; None: a robot of which nothing is known.
    """

    def __init__(
        self, file: BinaryIO, epoch_ns: int, name: str, scene: Scene | None = None
    ) -> None:
        self._writer = Writer(file)
        self._writer.start(library=_LIBRARY)
        self._encode = msgspec.json.Encoder().encode
        self._entries = LogEntries(epoch_ns, name, scene or Scene())
        self._channels = {topic: self._channel(topic, *known) for topic, known in TOPICS.items()}

    def _channel(self, topic: str, name: str, schema: JsonSchema) -> int:
        """Register a topic with the name of its schema."""
        schema_id = self._writer.register_schema(
            name, SchemaEncoding.JSONSchema, self._encode({"title": name, **schema})
        )
        return self._writer.register_channel(topic, MessageEncoding.JSON, schema_id)

    def add(self, message: Published) -> None:
        """Add a message at its stamp."""
        self._write(self._entries.of(message))

    def _write(self, entries: Iterable[Entry]) -> None:
        """Write entries."""
        for topic, wall_ns, content in entries:
            self._writer.add_message(self._channels[topic], wall_ns, self._encode(content), wall_ns)

    def flush(self) -> None:
        """Hand all that was added to the kernel, where a kill does not reach it."""
        self._writer.flush()

    def close(self) -> None:
        """Write the newest maps and the index; the file is complete then."""
        self._write(self._entries.newest_maps())
        self._writer.finish()


def is_complete(path: Path) -> bool:
    """Return whether a log was closed in order."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > 2 * len(MCAP0_MAGIC) and file.read() == MCAP0_MAGIC


@dataclass(frozen=True, slots=True)
class RecoveredLog:
    """Result of a recovery.

    Parameters
    ----------
    messages
        Kept.
    gaps
        Damaged places that were left out; not the end of a log that was merely cut.
    unknown
        Messages left out since the definition of their topic was in a gap.
    kept_aside
        Path of the original log, if anything was left out.
    was_intact
        Whether it was complete, and is unchanged.
    """

    messages: int
    gaps: tuple[Gap, ...]
    unknown: int
    kept_aside: Path | None
    was_intact: bool = False

    def loss(self) -> str:
        """Return a note on omitted messages, to follow another sentence; empty if none."""
        if self.kept_aside is None:
            return ""
        lost = sum(gap.length for gap in self.gaps)
        places = f"{len(self.gaps)} damaged place{'s' if len(self.gaps) != 1 else ''}"
        unknown = f", and {self.unknown} messages of unknown topics" if self.unknown else ""
        return f"; left out {places}, {lost} bytes{unknown}; as it was: {self.kept_aside}"


def recover(path: Path) -> RecoveredLog:
    """Make a log that was cut or damaged complete, with all its whole chunks.

    A whole one stays as it is. The file is replaced when the whole one is on the disk; until then
    that is `NAME.mcap.part`. Mode and owner stay, the owner where the system lets us. Where more is
    lost than the end of a log that was cut, the log as it was becomes `NAME.mcap.damaged-1` and so
    on.

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
            raise LogInUseError(f"{path}: is still being written; its writer completes it")
        if source.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise McapLogError(f"{path}: not an MCAP file")
        if is_complete(path) and (whole := _messages_of_intact(source)) is not None:
            return RecoveredLog(whole, (), 0, None, was_intact=True)
        source.seek(len(MCAP0_MAGIC))
        with part_file(path) as file:
            _take_owner_and_mode(source, file)
            messages, gaps, unknown = _copy(source, file)
            if not gaps and not unknown:
                return RecoveredLog(messages, (), 0, None)
            file.flush()
            os.fsync(file.fileno())  # before the log is replaced
            return RecoveredLog(messages, gaps, unknown, _set_aside(path))


def _messages_of_intact(source: BinaryIO) -> int | None:
    """Return how many messages a log holds; None if a record or its index is damaged."""
    source.seek(-_FOOTER.size - len(MCAP0_MAGIC), io.SEEK_END)
    opcode, _, begin, _, crc = _FOOTER.unpack(source.read(_FOOTER.size))
    source.seek(begin)
    index = source.read()[: -len(MCAP0_MAGIC) - 4]
    if opcode != Opcode.FOOTER or begin == 0 or crc not in (0, zlib.crc32(index)):
        return None
    try:
        source.seek(0)
        summary = make_reader(source).get_summary()
    except (McapError, ValueError, struct.error, EOFError):
        return None
    source.seek(len(MCAP0_MAGIC))
    messages = 0
    for record in whole_records(source):
        if isinstance(record, Gap):
            return None
        messages += isinstance(record, Message)
    counted = None if summary is None else summary.statistics
    return messages if counted is not None and counted.message_count == messages else None


def log_records(source: BinaryIO) -> Iterator[McapRecord | Gap]:
    """Yield as `whole_records`; in a log of robotctl its definitions too, where a gap took them."""
    is_own = is_defined = False
    for record in whole_records(source):
        if isinstance(record, Header):
            is_own = record.library == _LIBRARY
        is_defined |= isinstance(record, Channel)
        yield record
        if isinstance(record, Gap) and not record.is_cut and is_own and not is_defined:
            is_defined = True
            yield from _definitions()


def _definitions() -> Iterator[Schema | Channel]:
    """Yield the first entries of each of our logs."""
    file = io.BytesIO()
    log = McapLog(file, 0, "")
    log.add(Notice(0, 6, ""))  # without a message, definitions are not written
    log.close()
    for record in whole_records(file):
        if isinstance(record, Schema | Channel):
            yield record


def _take_owner_and_mode(source: BinaryIO, target: BinaryIO) -> None:
    """Give a file the owner and the mode of another."""
    status = os.fstat(source.fileno())
    with suppress(PermissionError):  # only root can change the owner of files
        os.fchown(target.fileno(), status.st_uid, status.st_gid)
    os.fchmod(target.fileno(), stat.S_IMODE(status.st_mode))


def _set_aside(path: Path) -> Path:
    """Rename a damaged log to a name that is free."""
    taken = {each.name for each in path.parent.iterdir()}
    return path.rename(path.with_name(damaged_name(path.name, taken)))


def _copy(source: BinaryIO, target: BinaryIO) -> tuple[int, tuple[Gap, ...], int]:
    """Copy whole records; return how many messages, the gaps, and messages of unknown topics."""
    writer = Writer(target)
    writer.start(library=f"{_LIBRARY}, recovered")
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    gaps = []
    count = unknown = 0
    for record in log_records(source):
        if isinstance(record, Gap):
            if not record.is_cut:
                gaps.append(record)
        elif isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = writer.register_channel(
                record.topic,
                record.message_encoding,
                schemas.get(record.schema_id, 0),
                record.metadata,
            )
        elif isinstance(record, Message):
            if record.channel_id not in channels:
                unknown += 1
                continue
            writer.add_message(
                channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
            count += 1
    writer.finish()
    return count, tuple(gaps), unknown
