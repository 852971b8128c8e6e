"""Recovery of MCAP logs that were cut or damaged, without losing a byte.

A log is replaced once its successor is on the disk and was read back with every recovered message.
If anything except the unwritten end is left out, the original log stays beside it.
"""

from __future__ import annotations

import io
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC, Writer

from robotctl.errors import RobotctlError
from robotctl.logs.mcap.log import LIBRARY, McapLog
from robotctl.logs.mcap.records import Gap, whole_records
from robotctl.messages.control import Notice
from robotctl.runtime.storage.atomic_file import part_file
from robotctl.runtime.storage.ring_file import hold
from robotctl.runtime.storage.state_file import damaged_name

_FOOTER: Final = struct.Struct("<BQQQI")
"""Kind and length; offsets of the index and of its offsets; CRC-32 of all up to itself, or 0."""
_ROS_2: Final = ("ros2msg", "ros2idl")
"""Encodings of schemas with the profile of ROS 2."""


class McapLogError(RobotctlError):
    """A log is not an MCAP file, or nothing in it can be recovered."""


class LogInUseError(McapLogError):
    """A log is still being written."""


@dataclass(frozen=True, slots=True)
class RecoveredLog:
    """Result of a recovery.

    Parameters
    ----------
    messages
        Messages in the completed log.
    gaps
        Unreadable parts that may have held content.
    unknown
        Messages left out because the definition of their topic was in a gap.
    kept_aside
        Path of the original log, if anything was left out.
    was_intact
        Whether the log was complete, and is unchanged.
    """

    messages: int
    gaps: tuple[Gap, ...] = ()
    unknown: int = 0
    kept_aside: Path | None = None
    was_intact: bool = False

    def loss(self) -> str:
        """Return a note on omissions, to follow another sentence; empty without any."""
        if self.kept_aside is None:
            return ""
        damaged = [gap for gap in self.gaps if not gap.is_cut]
        parts = []
        if damaged:
            places = f"{len(damaged)} damaged place{'s' if len(damaged) != 1 else ''}"
            parts.append(f"{places}, {sum(gap.lost for gap in damaged)} bytes")
        parts += [f"the cut end, {gap.lost} bytes of data" for gap in self.gaps if gap.is_cut]
        if self.unknown:
            parts.append(f"{self.unknown} messages of unknown topics")
        return f"; left out {', and '.join(parts)}; as it was: {self.kept_aside}"


def is_complete(path: Path) -> bool:
    """Return whether a log was closed properly."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MCAP0_MAGIC)))
        return size > 2 * len(MCAP0_MAGIC) and file.read() == MCAP0_MAGIC


def recover(path: Path) -> RecoveredLog:
    """Complete a log that was cut or damaged, with all its complete records.

    An intact one is unchanged. The file is replaced when the new one is on the disk and was read
    back; until then that is `NAME.mcap.part`. Mode and owner stay, the owner if permitted. If
    anything is left out, the original log becomes `NAME.mcap.damaged-1` and so on.

    Raises
    ------
    LogInUseError
        If a live process writes it; it is unchanged.
    McapLogError
        If it is not an MCAP file, or no message can be recovered; it is unchanged.
    OSError
        If it cannot be read or written; it is unchanged.
    """
    with path.open("rb") as source:
        if not hold(source):
            raise LogInUseError(f"{path}: is still being written; its writer completes it")
        if source.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise McapLogError(f"{path}: not an MCAP file")
        if is_complete(path) and (whole := _messages_of_intact(source)) is not None:
            return RecoveredLog(whole, was_intact=True)
        with part_file(path) as file:
            _take_owner_and_mode(source, file)
            copy = _Copy(source, file)
            gaps = tuple(gap for gap in copy.gaps if gap.lost)
            if not copy.messages:
                raise McapLogError(
                    f"{path}: no message in it can be recovered{_why(copy)}; left as it is"
                )
            _read_back(path, Path(file.name), copy.messages)
            aside = _keep_beside(path, source) if gaps or copy.unknown else None
            return RecoveredLog(copy.messages, gaps, copy.unknown, aside)


def _why(copy: _Copy) -> str:
    """Return why no message of a log can be recovered."""
    if copy.unknown:
        return f": {copy.unknown} messages are of topics whose definitions are lost"
    lost = sum(gap.lost for gap in copy.gaps)
    return f": {lost} bytes of data cannot be read" if lost else ": it holds none"


def _messages_of_intact(source: BinaryIO) -> int | None:
    """Return the number of messages in a log; None if a record or its index is damaged."""
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
    messages = 0
    for record in whole_records(source):
        if isinstance(record, Gap):
            return None
        messages += isinstance(record, Message)
    counted = None if summary is None else summary.statistics
    return messages if counted is not None and counted.message_count == messages else None


def log_records(source: BinaryIO) -> Iterator[McapRecord | Gap]:
    """Yield as `whole_records`; for a log of robotctl also definitions lost in a gap."""
    is_own = is_defined = False
    for record in whole_records(source):
        if isinstance(record, Header):
            is_own = record.library.startswith(LIBRARY)
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


def _read_back(path: Path, part: Path, messages: int) -> None:
    """Refuse a completed log that cannot be read back with all its messages."""
    with part.open("rb") as file:
        os.fsync(file.fileno())
        found = _messages_of_intact(file)
    if found != messages:
        raise McapLogError(
            f"{path}: the completed log reads back with {found} of {messages} messages; the disk "
            "may be failing; left as it is"
        )


def _keep_beside(path: Path, source: BinaryIO) -> Path:
    """Link a damaged log to a second, free name; its own is replaced next."""
    taken: set[str] = set()
    for each in path.parent.glob(f"{path.name}.damaged-*"):
        if os.path.samestat(each.stat(), os.fstat(source.fileno())):
            return each  # of a recovery that was interrupted
        taken.add(each.name)
    aside = path.with_name(damaged_name(path.name, taken))
    try:
        aside.hardlink_to(path)
    except OSError:  # a disk without links, as FAT
        path.rename(aside)
    return aside


class _Copy:
    """Copies complete records of one log to another, and counts the losses."""

    def __init__(self, source: BinaryIO, target: BinaryIO) -> None:
        self.messages = self.unknown = 0
        self.gaps: list[Gap] = []
        self._schemas: dict[int, int] = {}
        self._channels: dict[int, int] = {}
        writer = Writer(target)
        writer.start(*_heading(source))
        for record in log_records(source):
            if isinstance(record, Gap):
                self.gaps.append(record)
            else:
                self._write(writer, record)
        writer.finish()
        target.flush()

    def _write(self, writer: Writer, record: McapRecord) -> None:
        """Write one record with the new log's ids of schemas and channels."""
        if isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = writer.register_schema(
                record.name, record.encoding, record.data
            )
        elif isinstance(record, Channel) and record.id not in self._channels:
            self._channels[record.id] = writer.register_channel(
                record.topic,
                record.message_encoding,
                self._schemas.get(record.schema_id, 0),
                record.metadata,
            )
        elif isinstance(record, Message):
            channel = self._channels.get(record.channel_id)
            if channel is None:
                self.unknown += 1
                return
            self.messages += 1
            writer.add_message(
                channel, record.log_time, record.data, record.publish_time, record.sequence
            )
        elif isinstance(record, Attachment):
            writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)


def _heading(source: BinaryIO) -> tuple[str, str]:
    """Return profile and library of a recovered log, by which readers recognise its kind."""
    for record in log_records(source):
        if isinstance(record, Header):
            return record.profile, f"{record.library}, recovered"
        if isinstance(record, Schema) and record.encoding in _ROS_2:
            return "ros2", "recovered"
    return "", "recovered"
