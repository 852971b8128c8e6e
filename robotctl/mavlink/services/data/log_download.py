"""Logs of `--record` over the older messages for them: list and read, as MAVLink FTP's `/@LOGS`.

The messages number the files from 1, the newest last, which is what stations take for the latest;
so empty ones come first. LOG_DATA carries 90 bytes, and fewer where the file ends. Source: the
messages' descriptions in MAVLink's common dialect.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context
from robotctl.mavlink.frames import UINT32_MAX
from robotctl.mavlink.ftp.files import Files, NoFiles, OpenFile
from robotctl.mavlink.ftp.payload import FtpRefused
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer

LOGS: Final = "@LOGS"
A_MESSAGE: Final = 90
"""Bytes of LOG_DATA."""
PER_STEP: Final = 8
"""Messages of each kind in a step of 10 ms: 70 kB/s."""
MOST_LOGS: Final = 1000
DEEPEST: Final = 2
"""Depth to which folders are listed: those of runs, and the files in them."""


class _Log(NamedTuple):
    """One file; in the order of numbers."""

    has_content: bool
    modified_s: int
    path: str
    size: int


@dataclass(slots=True)
class _Reading:
    """One log that is read by one peer."""

    peer: Peer
    number: int
    file: OpenFile
    offset: int
    end: int


class LogDownload(Microservice):
    """Lists logs, and sends one at a time."""

    handles = frozenset(
        {
            common.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
            common.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
            common.MAVLINK_MSG_ID_LOG_REQUEST_END,
            common.MAVLINK_MSG_ID_LOG_ERASE,
        }
    )

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._files: Files = context.folders.get(LOGS, NoFiles())
        self._logs: list[_Log] = []
        """Logs of the last list, whose numbers stay."""
        self._entries: list[tuple[Message, Peer]] = []
        self._reading: _Reading | None = None

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a message of the protocol."""
        match message.get_msgId():
            case common.MAVLINK_MSG_ID_LOG_REQUEST_LIST:
                self._list(message.start, message.end, peer)
            case common.MAVLINK_MSG_ID_LOG_REQUEST_DATA:
                self._open(message, peer)
            case common.MAVLINK_MSG_ID_LOG_REQUEST_END:
                if self._reading is not None and self._reading.peer == peer:
                    self._end()
            case _:
                self._context.say(now_ns, "Logs: remove them on the robot's disk")

    def step(self, now_ns: int) -> None:  # noqa: ARG002
        """Send the next entries and parts."""
        for entry, peer in self._entries[:PER_STEP]:
            self._context.links.reply(entry, peer)
        del self._entries[:PER_STEP]
        for _ in range(PER_STEP):
            if self._reading is not None:
                self._send_part(self._reading)

    def _list(self, first: int, last: int, peer: Peer) -> None:
        """Queue LOG_ENTRY of the logs asked for; without logs one of number 0."""
        self._logs = self._found()
        count = len(self._logs)
        numbers = range(max(first, 1), min(last, count) + 1) if count else range(1)
        self._entries = [each for each in self._entries if each[1] != peer]
        for number in numbers:
            log = self._logs[number - 1] if count else _Log(False, 0, "", 0)
            time_s = log.modified_s if log.has_content else 0
            entry = common.MAVLink_log_entry_message(
                number, count, count, time_s & UINT32_MAX, log.size & UINT32_MAX
            )
            self._entries.append((entry, peer))

    def _found(self) -> list[_Log]:
        """Return the logs; the newest ones if there are too many."""
        return sorted(self._within("", 0))[-MOST_LOGS:]

    def _within(self, folder: str, depth: int) -> Iterator[_Log]:
        """Yield the logs in a folder."""
        try:
            entries = self._files.list(folder)
        except FtpRefused:
            return
        for name, size, modified_s in entries:
            path = f"{folder}/{name}" if folder else name
            if size is not None:
                yield _Log(size > 0, modified_s, path, size)
            elif depth < DEEPEST:
                yield from self._within(path, depth + 1)

    def _open(self, message: Message, peer: Peer) -> None:
        """Begin to send a part of a log; another reader is left alone."""
        if self._reading is not None and self._reading.peer != peer:
            if self._reading.peer in self._context.peers:
                return
            self._end()
        if not self._logs:
            self._logs = self._found()
        if not 1 <= message.id <= len(self._logs):
            return
        if self._reading is None or self._reading.number != message.id:
            self._end()
            try:
                file = self._files.open(self._logs[message.id - 1].path)
            except FtpRefused:
                return
            self._reading = _Reading(peer, message.id, file, 0, 0)
        self._reading.offset = message.ofs
        self._reading.end = message.ofs + message.count

    def _send_part(self, reading: _Reading) -> None:
        """Send LOG_DATA; a short one ends the log, and the file stays open for more."""
        if reading.offset >= reading.end or reading.peer not in self._context.peers:
            return
        size = min(A_MESSAGE, reading.end - reading.offset)
        try:
            data = reading.file.read(reading.offset, size)
        except FtpRefused:
            self._end()
            return
        part = common.MAVLink_log_data_message(
            reading.number, reading.offset, len(data), list(data.ljust(A_MESSAGE, b"\0"))
        )
        self._context.links.reply(part, reading.peer)
        reading.offset = reading.end if len(data) < size else reading.offset + len(data)

    def _end(self) -> None:
        """Close the log that is read."""
        if self._reading is not None:
            self._reading.file.close()
            self._reading = None
