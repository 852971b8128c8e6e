"""Record of the control core's inputs and outputs, and their replay bit for bit.

A record is a sequence of length-prefixed msgpack messages: one `RecordHeader`, then a `Checkpoint`
followed by the `Tick` of each step, then perhaps more of both. A record that was cut short (a kill,
a full disk) reads up to its last whole tick. Each checkpoint holds the core between two steps, so a
record may begin anywhere in a run and may have gaps.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import BinaryIO, Final, TypeAlias

import msgspec

from robotctl.core.checkpoint import CheckpointError, fields_of, misfit, restored
from robotctl.core.control_core import ControlCore, Inputs, Outputs
from robotctl.errors import RobotctlError

LENGTH: Final = struct.Struct("<I")
_MAX_LENGTH: Final = 1 << 20


class RecordError(RobotctlError):
    """A record cannot be read."""


class RecordHeader(msgspec.Struct, frozen=True):
    """Data that a replay needs besides the ticks.

    `robot_json` is the whole configuration as JSON; the pose is where odometry started; `fields`
    are `fields_of` the core, without which checkpoints are taken as they come. `epoch_ns`, added to
    the times of ticks, gives those of the logs; 0 in virtual time and in records of older versions.
    """

    version: str
    robot_json: str
    x_m: float
    y_m: float
    theta_rad: float
    fields: dict[str, tuple[str, ...]] = {}
    epoch_ns: int = 0


class Checkpoint(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=0):
    """The core after `ticks` steps, as of `checkpoint`; empty: as it was made, or not kept."""

    ticks: int
    core: bytes = b""


_WHOLE_RUN: Final = Checkpoint(0)


class Tick(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=1):
    """One step: its time, all inputs and outputs, and its punctuality.

    `lag_ns` is the wake-up behind the deadline, `step_ns` the time from waking to having sent.
    """

    now_ns: int
    inputs: Inputs
    outputs: Outputs
    lag_ns: int = 0
    step_ns: int = 0


Entry: TypeAlias = Checkpoint | Tick


@dataclass(frozen=True, slots=True)
class Difference:
    """The first tick that a replay computed otherwise.

    Parameters
    ----------
    number
        Which step of the run, from 1.
    tick
        As recorded.
    outputs
        As computed.
    """

    number: int
    tick: Tick
    outputs: Outputs


@dataclass(frozen=True, slots=True)
class Replayed:
    """Result of a replay.

    Parameters
    ----------
    agreed
        Ticks whose outputs came out the same, bit for bit, before the first that did not.
    gaps
        Places where ticks are missing and the replay went on from a checkpoint.
    difference
        None if all agree.
    """

    agreed: int
    gaps: int
    difference: Difference | None


class Recorder:
    """Encodes a run, or the rest of it, and passes it on.

    Parameters
    ----------
    sink
        Takes whole messages.
    header
        Sent first.
    begin
        The core before the first tick; by default the run begins with the record.
    """

    def __init__(
        self,
        sink: Callable[[bytes], object],
        header: RecordHeader,
        begin: Checkpoint = _WHOLE_RUN,
    ) -> None:
        self._sink = sink
        self._encoder = msgspec.msgpack.Encoder()
        self._sink(framed(self._encoder.encode(header)))
        self._sink(framed(self._encoder.encode(begin)))

    def record(self, now_ns: int, inputs: Inputs, outputs: Outputs) -> None:
        """Add one tick."""
        self._sink(framed(self._encoder.encode(Tick(now_ns, inputs, outputs))))


def read_record(file: BinaryIO, name: str) -> tuple[RecordHeader, Iterator[Entry]]:
    """Return the header and the entries of a record.

    Raises
    ------
    RecordError
        If the file is no record, or a whole message in it is damaged.
    """
    messages = _messages(file, name)
    first = next(messages, None)
    try:
        if first is None:
            raise RecordError(f"{name}: not a record of the control loop, or an empty one")
        header = msgspec.msgpack.decode(first, type=RecordHeader)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordError(f"{name}: not a record: {error}") from error
    return header, _entries(messages, name)


def is_cut(file: BinaryIO) -> bool:
    """Return whether a record ends within a message; one cut between two of them looks whole."""
    size = file.seek(0, 2)
    place = 0
    while place < size:
        file.seek(place)
        prefix = file.read(LENGTH.size)
        if len(prefix) < LENGTH.size:
            return True
        place += LENGTH.size + LENGTH.unpack(prefix)[0]
    return place > size


@dataclass(frozen=True, slots=True)
class ReplayedStep:
    """A recorded tick, done again.

    Parameters
    ----------
    number
        Which step of the run, from 1.
    tick
        As recorded.
    core
        After the step.
    outputs
        As computed.
    gaps
        Places so far where ticks are missing and the replay continued from a checkpoint.
    """

    number: int
    tick: Tick
    core: ControlCore
    outputs: Outputs
    gaps: int


def replay(
    make_core: Callable[[], ControlCore],
    entries: Iterable[Entry],
    name: str,
    fields: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Replayed:
    """Step a core through recorded inputs until an output differs; as `replay_steps`.

    Raises
    ------
    RecordError
        As `replay_steps`, and where the record has no tick.
    """
    encode = msgspec.msgpack.Encoder().encode
    agreed = gaps = 0
    for step in replay_steps(make_core, entries, name, fields):
        gaps = step.gaps
        # Encoded, nan equals nan and 0.0 differs from -0.0, as it should.
        if encode(step.outputs) != encode(step.tick.outputs):
            return Replayed(agreed, gaps, Difference(step.number, step.tick, step.outputs))
        agreed += 1
    if not agreed:
        raise RecordError(f"{name}: no tick is in it; there is nothing to replay")
    return Replayed(agreed, gaps, None)


def replay_steps(
    make_core: Callable[[], ControlCore],
    entries: Iterable[Entry],
    name: str,
    fields: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Iterator[ReplayedStep]:
    """Step a core through recorded inputs, whatever the result.

    Parameters
    ----------
    make_core
        Builds the core in its state before the first step.
    entries
        Of a record.
    name
        Of the record, for errors.
    fields
        Of its header: what its checkpoints are made of.

    Raises
    ------
    RecordError
        If a checkpoint cannot be read or does not fit the classes that are here, or the record
        has nothing to begin with.
    """
    core: ControlCore | None = None
    is_made = False
    ticks = gaps = 0
    for entry in entries:
        if isinstance(entry, Checkpoint):
            if core is None or entry.ticks != ticks:
                gaps += core is not None
                is_made = entry.ticks == 0
                core = make_core() if is_made else _core_of(entry, make_core, name, fields)
                ticks = entry.ticks
            continue
        if core is None:
            raise RecordError(f"{name}: it begins without a checkpoint")
        ticks += 1
        try:
            outputs = core.step(entry.inputs, entry.now_ns)
        except (AttributeError, TypeError, ValueError, ArithmeticError, LookupError) as error:
            if is_made:
                raise
            raise RecordError(f"{name}: its checkpoint is of another robotctl: {error}") from error
        yield ReplayedStep(ticks, entry, core, outputs, gaps)


def framed(payload: bytes) -> bytes:
    """Put the length in front."""
    return LENGTH.pack(len(payload)) + payload


def _core_of(
    entry: Checkpoint,
    make_core: Callable[[], ControlCore],
    name: str,
    fields: Mapping[str, tuple[str, ...]],
) -> ControlCore:
    """Return the core at a checkpoint in the middle of a run."""
    if not entry.core:
        raise RecordError(f"{name}: after tick {entry.ticks} the core's state was not recorded")
    if fields and (why := misfit(fields, fields_of(make_core()))):
        raise RecordError(
            f"{name}: after tick {entry.ticks}: its checkpoint is of another robotctl: {why}"
        )
    try:
        return restored(entry.core)
    except CheckpointError as error:
        raise RecordError(f"{name}: after tick {entry.ticks}: {error}") from error


def _messages(file: BinaryIO, name: str) -> Iterator[bytes]:
    """Yield whole messages; a torn tail ends the record."""
    place = 0
    while len(prefix := file.read(LENGTH.size)) == LENGTH.size:
        (length,) = LENGTH.unpack(prefix)
        if not 0 < length <= _MAX_LENGTH:
            raise RecordError(
                f"{name}: not a record, or damaged at byte {place}: a message of {length} bytes"
            )
        payload = file.read(length)
        if len(payload) < length:
            return
        yield payload
        place += LENGTH.size + length


def _entries(messages: Iterator[bytes], name: str) -> Iterator[Entry]:
    """Decode the messages after the header."""
    decoder = msgspec.msgpack.Decoder[Entry](Entry)
    for index, payload in enumerate(messages):
        try:
            yield decoder.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise RecordError(f"{name}: message {index + 1} is damaged: {error}") from error
