"""Record of the control core's inputs and outputs, and their replay bit for bit.

A record is a sequence of length-prefixed msgpack messages: one `RecordHeader`, then a `Checkpoint`
followed by the `Tick` of each step, then perhaps more of both. A record that was cut short (a kill,
a full disk) reads up to its last whole tick. Each checkpoint holds the state of the core between
two steps, so a record may begin anywhere in a run and may have gaps.
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

    `robot_json` is the whole configuration as JSON; the pose is the start of odometry; `fields` are
    `fields_of` the core, without which checkpoints are not checked. `epoch_ns`, added to the times
    of ticks, gives those of the logs; 0 in virtual time and in records of older versions.
    """

    version: str
    robot_json: str
    x_m: float
    y_m: float
    theta_rad: float
    fields: dict[str, tuple[str, ...]] = {}
    epoch_ns: int = 0


class Checkpoint(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=0):
    """State of the core after `ticks` steps, from `checkpoint`; empty: initial, or unknown."""

    ticks: int
    core: bytes = b""


_WHOLE_RUN: Final = Checkpoint(0)


class Tick(msgspec.Struct, frozen=True, array_like=True, gc=False, tag=1):
    """One step: its time, all inputs and outputs, and its punctuality.

    `lag_ns` is the wake-up latency after the deadline, `step_ns` the time from wake-up to send.
    """

    now_ns: int
    inputs: Inputs
    outputs: Outputs
    lag_ns: int = 0
    step_ns: int = 0


Entry: TypeAlias = Checkpoint | Tick


@dataclass(frozen=True, slots=True)
class Difference:
    """The first tick with another result in a replay.

    Parameters
    ----------
    number
        Number of the step in the run, from 1.
    tick
        Recorded tick.
    outputs
        Computed outputs.
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
        Ticks with the same outputs, bit for bit, before the first other one.
    gaps
        Number of gaps after which the replay continued from a checkpoint.
    difference
        First difference; None if all agree.
    """

    agreed: int
    gaps: int
    difference: Difference | None


class Recorder:
    """Encodes a run, or the rest of it, for a sink.

    Parameters
    ----------
    sink
        Function that takes whole messages.
    header
        First message.
    begin
        Core before the first tick; by default the run begins with the record.
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
        If the file is not a record, or a whole message in it is damaged.
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
    """Return whether a record ends within a message; a cut between two of them is not seen."""
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
    """A replayed tick.

    Parameters
    ----------
    number
        Number of the step in the run, from 1.
    tick
        Recorded tick.
    core
        Core after the step.
    outputs
        Computed outputs.
    gaps
        Number of gaps so far after which the replay continued from a checkpoint.
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
    """Step a core through recorded inputs until an output differs, see `replay_steps`.

    Raises
    ------
    RecordError
        As for `replay_steps`, and if the record has no tick.
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
        Function that builds the core in its state before the first step.
    entries
        Entries of a record.
    name
        Name of the record, for errors.
    fields
        `fields` of its header, the structure of its checkpoints.

    Raises
    ------
    RecordError
        If a checkpoint cannot be read or does not fit the present classes, or the record has no
        start.
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
    """Return a message with its length in front."""
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
