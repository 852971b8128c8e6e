"""Record of the control core's inputs and outputs, and their replay bit for bit.

A record is a sequence of length-prefixed msgpack messages: one `RecordHeader`, then one `Tick`
for each step. A record that was cut short (a kill, a full disk) reads up to its last whole tick.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import BinaryIO

import msgspec

from robotctl.errors import RobotctlError
from robotctl.runtime.core import ControlCore, Inputs
from robotctl.runtime.messages import WheelCommand

_LENGTH = struct.Struct("<I")
_MAX_LENGTH = 1 << 20


class RecordError(RobotctlError):
    """A record cannot be read."""


class RecordHeader(msgspec.Struct, frozen=True):
    """What a replay needs besides the ticks.

    `robot_json` is the whole configuration as JSON; the pose is where odometry started.
    """

    version: str
    robot_json: str
    x_m: float
    y_m: float
    theta_rad: float


class Tick(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One step: its time, its inputs, and the command that came of them."""

    now_ns: int
    inputs: Inputs
    command: WheelCommand


class Recorder:
    """Encodes ticks and hands them on in batches.

    Parameters
    ----------
    sink
        Takes whole messages; must not block the caller (a socket, a file in lockstep).
    header
        Sent first, and again on `begin`.
    """

    def __init__(self, sink: Callable[[bytes], object], header: RecordHeader) -> None:
        self._sink = sink
        self._encoder = msgspec.msgpack.Encoder()
        self._buffer = bytearray()
        self._header = _framed(self._encoder.encode(header))
        self._sink(self._header)

    def record(self, now_ns: int, inputs: Inputs, command: WheelCommand) -> None:
        """Add one tick."""
        payload = self._encoder.encode(Tick(now_ns, inputs, command))
        self._buffer += _LENGTH.pack(len(payload))
        self._buffer += payload

    def flush(self) -> None:
        """Hand on what was added since the last call."""
        if self._buffer:
            self._sink(bytes(self._buffer))
            self._buffer.clear()


def read_record(file: BinaryIO, name: str) -> tuple[RecordHeader, Iterator[Tick]]:
    """Return the header and the ticks of a record.

    Raises
    ------
    RecordError
        Where the file is no record, or a whole message in it is damaged.
    """
    first = next(_messages(file), None)
    try:
        if first is None:
            raise RecordError(f"{name}: not a record of the control loop, or an empty one")
        header = msgspec.msgpack.decode(first, type=RecordHeader)
    except msgspec.DecodeError as error:
        raise RecordError(f"{name}: not a record: {error}") from error
    return header, _ticks(file, name)


def replay(core: ControlCore, ticks: Iterator[Tick]) -> tuple[int, Tick | None, WheelCommand]:
    """Step `core` through recorded inputs until a command differs.

    Returns
    -------
    The number of ticks that agreed, the first that differs (None: none did), and the last
    command computed.
    """
    agreed, command = 0, WheelCommand()
    for tick in ticks:
        command = core.step(tick.inputs, tick.now_ns).command
        if command != tick.command:
            return agreed, tick, command
        agreed += 1
    return agreed, None, command


def _framed(payload: bytes) -> bytes:
    """Put the length in front."""
    return _LENGTH.pack(len(payload)) + payload


def _messages(file: BinaryIO) -> Iterator[bytes]:
    """Yield whole messages; a torn tail ends the record."""
    while len(prefix := file.read(_LENGTH.size)) == _LENGTH.size:
        (length,) = _LENGTH.unpack(prefix)
        if length > _MAX_LENGTH:
            return
        payload = file.read(length)
        if len(payload) < length:
            return
        yield payload


def _ticks(file: BinaryIO, name: str) -> Iterator[Tick]:
    """Decode the messages after the header."""
    decoder = msgspec.msgpack.Decoder(Tick)
    for index, payload in enumerate(_messages(file)):
        try:
            yield decoder.decode(payload)
        except msgspec.DecodeError as error:
            raise RecordError(f"{name}: tick {index} is damaged: {error}") from error
