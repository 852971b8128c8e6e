"""Messages of a recording in their order, of logs of states and of records of the control loop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import chain, islice
from operator import itemgetter
from pathlib import Path
from typing import Final

import msgspec

from robotctl.app.processes.robot import make_core
from robotctl.config.robot_file import RobotConfig
from robotctl.logs.formats.robotctl_log import is_mcap, json_messages
from robotctl.logs.mcap.foxglove import FrameTransforms
from robotctl.logs.mcap.restored import RESTORED, Restored
from robotctl.logs.mcap.scene import sonar_mounts
from robotctl.messages.control import ControlState, LoopStatistics
from robotctl.model.sensors.sonar import SonarMount
from robotctl.runtime.flight.recorder import (
    RecordError,
    RecordHeader,
    is_cut,
    read_record,
    replay_steps,
)
from robotctl.workbench.logs.rows import KINDS, RecordingError
from robotctl.workbench.replay.replay import robot_of

_NO_FIGURES: Final = LoopStatistics()
_LATE_NS: Final = 500_000_000


@dataclass(frozen=True, slots=True)
class Timed:
    """A message, and what is to be added to its stamp to get wall time [ns]."""

    epoch_ns: int
    message: Restored

    @property
    def wall_ns(self) -> int:
        """Wall time [ns since 1970]."""
        return self.message.stamp_ns + self.epoch_ns


def logged_messages(files: Sequence[Path], notes: list[str]) -> Iterator[Timed]:
    """Yield the messages of logs of states that another program can make something of.

    The epoch is that of the states around; messages before the first state are passed over.

    Raises
    ------
    RecordingError
        If a message is none.
    """
    epoch_ns: int | None = None
    for file in files:
        for topic, record in json_messages(file, notes):
            stamp_ns = record.log_time - (epoch_ns or 0)
            try:
                message = _restored(topic, record.data, stamp_ns)
            except (msgspec.DecodeError, LookupError, TypeError, ValueError) as error:
                raise RecordingError(
                    f"{file}: topic {topic}, message at {record.log_time} ns: {error}"
                ) from error
            if isinstance(message, ControlState):
                epoch_ns = record.log_time - message.stamp_ns
            if message is not None and epoch_ns is not None:
                yield Timed(epoch_ns, message)


def _restored(topic: str, data: bytes, stamp_ns: int) -> Restored | None:
    """Return a message; None for topics that are pictures."""
    read = RESTORED.get(topic)
    if read is None:
        return None
    content = msgspec.json.decode(data)
    return read(content.get("stamp_ns", stamp_ns), content)


@dataclass(frozen=True, slots=True)
class RecordedRobot:
    """A record of the control loop: its heading, the robot, and what its process published."""

    header: RecordHeader
    config: RobotConfig
    messages: Iterator[Timed]


def recorded_messages(file: Path, notes: list[str]) -> RecordedRobot:
    """Return the states after each tick, recomputed as `replay` does, and the notices.

    Raises
    ------
    RecordingError
        If it is no record, or of another robotctl.
    OSError
        If it cannot be read.
    """
    try:
        with file.open("rb") as source:
            header, _ = read_record(source, str(file))
        config, _ = robot_of(header, file)
    except RecordError as error:
        raise RecordingError(f"{error}; needed is {KINDS}") from error
    return RecordedRobot(header, config, _replayed(file, notes))


def _replayed(file: Path, notes: list[str]) -> Iterator[Timed]:
    try:
        with file.open("rb") as source:
            header, entries = read_record(source, str(file))
            config, options = robot_of(header, file)
            for step in replay_steps(
                lambda: make_core(config, options), entries, str(file), header.fields
            ):
                for notice in step.tick.outputs.notices:
                    yield Timed(header.epoch_ns, notice)
                state = step.core.snapshot(step.tick.now_ns, _NO_FIGURES)
                # Neither the odometer nor the figures of the loop are in a record.
                state = msgspec.structs.replace(state, odometer_m=float("nan"))
                yield Timed(header.epoch_ns, state)
            if is_cut(source):
                notes.append(f"{file}: was cut short, read up to there")
    except RecordError as error:
        notes.append(f"{error}; read up to there")


def sonars_of(files: Sequence[Path]) -> tuple[SonarMount, ...]:
    """Return where the sonars of a recorded robot sit; empty if that is not told."""
    if not all(map(is_mcap, files)):
        return recorded_messages(files[0], []).config.sonar
    for topic, record in json_messages(files[0], []):
        if topic == "sensor_frames":
            frames = msgspec.json.decode(record.data, type=FrameTransforms).transforms
            return sonar_mounts(frames)
    return ()


def messages_of(files: Sequence[Path], notes: list[str]) -> Iterator[Timed]:
    """Return the messages of the files of a recording, of either kind; raises as both."""
    if all(map(is_mcap, files)):
        return by_stamp(logged_messages(files, notes))
    return recorded_messages(files[0], notes).messages  # a folder has logs of states only


def by_stamp(messages: Iterable[Timed]) -> Iterator[Timed]:
    """Yield messages in the order of their stamps: processes are logged one after the other.

    One that is older than half a second when it is logged comes at once. States that go back by
    more are those of another run.
    """
    waiting: list[tuple[int, int, Timed]] = []
    newest_ns = 0
    for number, each in enumerate(messages):
        if isinstance(each.message, ControlState):
            if each.wall_ns < newest_ns - _LATE_NS:
                yield from _in_order(waiting)
                waiting.clear()
            newest_ns = each.wall_ns
        heappush(waiting, (each.wall_ns, number, each))
        while waiting[0][0] < newest_ns - _LATE_NS:
            yield heappop(waiting)[2]
    yield from _in_order(waiting)


def _in_order(waiting: list[tuple[int, int, Timed]]) -> Iterator[Timed]:
    return (each for _, _, each in sorted(waiting, key=itemgetter(0, 1)))


def peek(messages: Iterator[Timed], count: int) -> tuple[list[Timed], Iterator[Timed]]:
    """Return the first messages, and all of them."""
    first = list(islice(messages, count))
    return first, chain(first, messages)
