"""The server's side of MAVLink FTP, a pure state machine: requests in, replies out."""

from __future__ import annotations

import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from robotctl.mavlink.ftp.files import Files, OpenFile
from robotctl.mavlink.ftp.payload import (
    MOST_BYTES,
    FtpError,
    FtpPayload,
    FtpRefused,
    Opcode,
    unpack,
)
from robotctl.messages.mavlink_port import Peer

SESSIONS_EACH: Final = 2
"""Maximum sessions of one sender at the same time."""
MOST_SESSIONS: Final = 8
"""Maximum sessions of all senders."""
IDLE_NS: Final = 20_000_000_000
"""Time without use after which a session is closed [ns]."""
REPEATED_NS: Final = 5_000_000_000
"""Time within which an equal request counts as a repetition [ns]."""
PER_STEP: Final = 6
"""Parts of a burst sent in a step: 600 in a second, 140 kB/s."""
BURST_PARTS: Final = 400
"""Maximum parts of a burst; a client that wants more asks again."""
CRC_BYTES: Final = 1 << 20
"""Part of a file that one step adds to its checksum [B]."""
MOST_SENDERS: Final = 16
"""Maximum number of senders whose last reply is kept."""


class Sender(NamedTuple):
    """Sender of a request, and where the answer goes."""

    system: int
    component: int
    peer: Peer


@dataclass(slots=True)
class _Session:
    """An open file."""

    file: OpenFile
    used_ns: int
    burst: Iterator[FtpPayload] | None = None
    """Parts that are still to be sent."""


@dataclass(slots=True)
class _Last:
    """The last request of a sender's session and its reply; None: not answered yet."""

    request: bytes
    received_ns: int
    reply: bytes | None = None


@dataclass(slots=True)
class _Sum:
    """A checksum under way."""

    sender: Sender
    request: FtpPayload
    file: OpenFile
    last: _Last
    offset: int = 0
    crc: int = field(default=0xFFFFFFFF)


class FtpServer:
    """Serves files to several clients.

    A session has the number that its client asks for, as ArduPilot's clients expect it, or the
    lowest that is free where that one is taken; numbers count for each sender alone.

    Parameters
    ----------
    files
        What is served.
    send
        Given a reply and who it is for.
    """

    def __init__(self, files: Files, send: Callable[[bytes, Sender], None]) -> None:
        self._files = files
        self._send = send
        self._sessions: dict[tuple[Sender, int], _Session] = {}
        self._last: OrderedDict[tuple[Sender, int], _Last] = OrderedDict()
        self._sums: list[_Sum] = []
        self._do: dict[int, Callable[[FtpPayload, Sender, int], FtpPayload]] = {
            Opcode.NONE: lambda asked, _sender, _now: _ack(asked),
            Opcode.TERMINATE_SESSION: self._terminate,
            Opcode.RESET_SESSIONS: self._reset,
            Opcode.LIST_DIRECTORY: self._list,
            Opcode.OPEN_FILE_RO: self._open,
            Opcode.OPEN_FILE_WO: self._open,
            Opcode.CREATE_FILE: self._open,
            Opcode.READ_FILE: self._read,
            Opcode.WRITE_FILE: self._write,
            Opcode.REMOVE_FILE: self._remove,
            Opcode.CREATE_DIRECTORY: self._make_folder,
            Opcode.REMOVE_DIRECTORY: self._remove_folder,
        }

    def receive(self, payload: bytes, sender: Sender, now_ns: int) -> None:
        """Carry out a request; one that is repeated is answered as before, not carried out."""
        asked = unpack(payload)
        if asked.opcode in {Opcode.ACK, Opcode.NAK}:  # of another server
            return
        place = sender, asked.session
        last = self._last.get(place)
        if (
            last is not None
            and last.request == payload
            and now_ns - last.received_ns <= REPEATED_NS
            and asked.opcode != Opcode.BURST_READ_FILE
        ):
            if last.reply is not None:
                self._send(last.reply, sender)
            return
        last = self._last[place] = _Last(payload, now_ns)
        self._last.move_to_end(place)
        while len(self._last) > MOST_SENDERS:
            self._last.popitem(last=False)
        reply = self._reply(asked, sender, last, now_ns)
        if reply is not None:
            last.reply = reply.pack()
            self._send(last.reply, sender)

    def _reply(
        self, asked: FtpPayload, sender: Sender, last: _Last, now_ns: int
    ) -> FtpPayload | None:
        """Return the reply; None: it comes with the next steps."""
        try:
            if asked.size > MOST_BYTES:
                raise FtpRefused(FtpError.INVALID_DATA_SIZE)
            if asked.opcode == Opcode.BURST_READ_FILE:
                session = self._session(asked, sender, now_ns)
                session.burst = _burst(session.file, asked)
                return None
            if asked.opcode == Opcode.CALC_FILE_CRC32:
                if len(self._sums) >= MOST_SESSIONS:
                    raise FtpRefused(FtpError.NO_SESSIONS_AVAILABLE)
                self._sums.append(_Sum(sender, asked, self._files.open(_path(asked)), last))
                return None
            if asked.opcode not in self._do:
                raise FtpRefused(FtpError.UNKNOWN_COMMAND)
            return self._do[asked.opcode](asked, sender, now_ns)
        except FtpRefused as refusal:
            return _nak(asked, refusal)

    def step(self, now_ns: int) -> None:
        """Send the next parts of bursts, sum up files, close unused ones."""
        for (sender, number), session in list(self._sessions.items()):
            if session.burst is not None:
                session.used_ns = now_ns
                self._send_parts(session, session.burst, sender)
            elif now_ns - session.used_ns > IDLE_NS:
                with suppress(FtpRefused):
                    self._close(sender, number)
        for each in list(self._sums):
            self._sum_up(each)

    def _send_parts(self, session: _Session, burst: Iterator[FtpPayload], sender: Sender) -> None:
        """Send a few parts of a burst."""
        for _ in range(PER_STEP):
            part = next(burst, None)
            if part is None:
                session.burst = None
                return
            self._send(part.pack(), sender)

    def _sum_up(self, work: _Sum) -> None:
        """Go on with a checksum; answer it at the file's end."""
        try:
            data = work.file.read(work.offset, CRC_BYTES)
            work.crc = zlib.crc32(data, work.crc)
            work.offset += len(data)
            if len(data) == CRC_BYTES:
                return
            # MAVLink's begins with 0 and is not inverted, zlib's is the inverse of both.
            reply = _ack(work.request, (work.crc ^ 0xFFFFFFFF).to_bytes(4, "little"))
        except FtpRefused as refusal:
            reply = _nak(work.request, refusal)
        work.file.close()
        self._sums.remove(work)
        work.last.reply = reply.pack()
        self._send(work.last.reply, work.sender)

    # What is asked for.

    def _session(self, asked: FtpPayload, sender: Sender, now_ns: int) -> _Session:
        session = self._sessions.get((sender, asked.session))
        if session is None:
            raise FtpRefused(FtpError.INVALID_SESSION)
        session.used_ns = now_ns
        return session

    def _close(self, sender: Sender, number: int) -> None:
        """End a session."""
        self._sessions.pop((sender, number)).file.close()

    def _terminate(self, asked: FtpPayload, sender: Sender, now_ns: int) -> FtpPayload:
        self._session(asked, sender, now_ns)
        self._close(sender, asked.session)
        return _ack(asked)

    def _reset(self, asked: FtpPayload, sender: Sender, _now_ns: int) -> FtpPayload:
        """End the sessions of a sender; those of others are not its."""
        for other, number in list(self._sessions):
            if other == sender:
                self._close(other, number)
        return _ack(asked)

    def _list(self, asked: FtpPayload, _sender: Sender, _now_ns: int) -> FtpPayload:
        """Return as many entries from a number on as there is room for."""
        entries = self._files.list(_path(asked))[asked.offset :]
        data = b""
        for entry in entries:
            kind = f"D{entry.name}" if entry.size is None else f"F{entry.name}\t{entry.size}"
            word = kind.encode("utf-8", "replace") + b"\0"
            if len(data) + len(word) > MOST_BYTES:
                break
            data += word
        if not data:
            raise FtpRefused(FtpError.END_OF_FILE)
        return _ack(asked, data)

    def _open(self, asked: FtpPayload, sender: Sender, now_ns: int) -> FtpPayload:
        """Open a file in a new session."""
        own = {number for other, number in self._sessions if other == sender}
        if len(own) >= SESSIONS_EACH or len(self._sessions) >= MOST_SESSIONS:
            raise FtpRefused(FtpError.NO_SESSIONS_AVAILABLE)
        number = asked.session
        if number in own:
            number = min({0, 1, 2} - own)
        path = _path(asked)
        if asked.opcode == Opcode.OPEN_FILE_RO:
            file = self._files.open(path)
        else:
            file = self._files.create(path, empty=asked.opcode == Opcode.CREATE_FILE)
        self._sessions[sender, number] = _Session(file, now_ns)
        reply = _ack(asked, min(file.size, 0xFFFFFFFF).to_bytes(4, "little"))
        return reply._replace(session=number)

    def _read(self, asked: FtpPayload, sender: Sender, now_ns: int) -> FtpPayload:
        file = self._session(asked, sender, now_ns).file
        data = file.read(asked.offset, asked.size or MOST_BYTES)
        if not data:
            raise FtpRefused(FtpError.END_OF_FILE)
        return _ack(asked, data)

    def _write(self, asked: FtpPayload, sender: Sender, now_ns: int) -> FtpPayload:
        self._session(asked, sender, now_ns).file.write(asked.offset, asked.data)
        return _ack(asked)

    def _remove(self, asked: FtpPayload, _sender: Sender, _now_ns: int) -> FtpPayload:
        self._files.remove(_path(asked))
        return _ack(asked)

    def _make_folder(self, asked: FtpPayload, _sender: Sender, _now_ns: int) -> FtpPayload:
        self._files.make_folder(_path(asked))
        return _ack(asked)

    def _remove_folder(self, asked: FtpPayload, _sender: Sender, _now_ns: int) -> FtpPayload:
        self._files.remove_folder(_path(asked))
        return _ack(asked)


def _burst(file: OpenFile, asked: FtpPayload) -> Iterator[FtpPayload]:
    """Yield the parts of a file from an offset on; the last one says that it is."""
    size, offset = asked.size or MOST_BYTES, asked.offset
    for part in range(BURST_PARTS):
        seq = asked.seq + part
        numbered = asked._replace(seq=seq & 0xFFFF, offset=offset)
        try:
            data = file.read(offset, size)
        except FtpRefused as refusal:
            yield _nak(numbered, refusal)
            return
        if not data:
            yield _nak(numbered, FtpRefused(FtpError.END_OF_FILE))
            return
        offset += len(data)
        ends = part == BURST_PARTS - 1 or offset >= file.size
        yield _ack(numbered, data)._replace(burst_complete=int(ends))
        if ends:
            return


def _path(asked: FtpPayload) -> str:
    """Return the path of a request, which ends with the data or with a zero byte."""
    try:
        return asked.data.partition(b"\0")[0].decode()
    except UnicodeDecodeError:
        raise FtpRefused(FtpError.FILE_NOT_FOUND) from None


def _ack(asked: FtpPayload, data: bytes = b"") -> FtpPayload:
    """Return the reply that something is done."""
    return FtpPayload(asked.seq + 1, asked.session, Opcode.ACK, data, asked.offset, 0, asked.opcode)


def _nak(asked: FtpPayload, refusal: FtpRefused) -> FtpPayload:
    """Return the reply that something cannot be done."""
    data = bytes([refusal.error, refusal.errno] if refusal.errno else [refusal.error])
    return _ack(asked, data)._replace(opcode=Opcode.NAK)
