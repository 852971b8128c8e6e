"""Sonar readings of our own recordings, from states and the record of the control loop.

States repeat the last range of each sonar and may miss one that was soon followed by another,
especially a missing echo, which comes late. The records `control-0001.rec` beside the log have
every frame, so these count, and the states only for times without a recorded frame.

Both have the robot's times, to which a log adds an epoch that each start of the recorder reads
again; after a boot the robot's times restart. A record does not name its epoch, so for a log with
several epochs only the states count.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Final, TypeAlias

import msgspec

from robotctl.logs.formats.robotctl_messages import LoggedState
from robotctl.messages.control import SonarFeedback
from robotctl.model.sensors.new_sonar_readings import NewSonarReadings
from robotctl.model.sensors.sonar import SonarMount, SonarReading, listening_ns
from robotctl.runtime.flight.recorder import RecordError, Tick, read_record

_REACH_M: Final = 4.0
"""Default maximum range of sonars [m], for the listening time without an echo."""

_IN_FRAME: Final = 4
"""Sonars of one frame."""

_Frames: TypeAlias = dict[tuple[int, int], SonarFeedback]
"""Frames by time of arrival [ns] and index of the first sonar."""


class _Robot(msgspec.Struct):
    """Used fields of a robot's configuration."""

    sonar: tuple[SonarMount, ...] = ()


@dataclass(slots=True)
class OwnSonars:
    """Sonar readings and mounting.

    Parameters
    ----------
    readings
        Readings with the times of the log, in their order.
    mounts
        Mountings; empty without a record of them.
    notes
        Sentences for people.
    """

    readings: list[SonarReading] = field(default_factory=list)
    mounts: tuple[SonarMount, ...] = ()
    notes: list[str] = field(default_factory=list)


def own_sonars(states: Sequence[tuple[int, LoggedState]], folder: Path) -> OwnSonars:
    """Return the sonar readings while the states were logged.

    Parameters
    ----------
    states
        States of one robot with the times of the log [ns], in their order.
    folder
        Folder of the records.

    Raises
    ------
    OSError
        If a record cannot be read.
    """
    found = OwnSonars()
    epochs = _epochs(states)
    paths = sorted(folder.glob("control-*.rec"))
    if len(epochs) > 1 and paths:
        found.notes.append(
            f"the log has {len(epochs)} epochs, after boots or restarts of the recorder: sonar "
            "ranges are those of the states; read its files one by one to get those of the records"
        )
    count = len(states[0][1].sonar_m)
    frames: _Frames = {}
    for path in paths:
        record = _record(path, found.notes, with_frames=len(epochs) == 1)
        if record is None:
            continue
        mounts, recorded = record
        if count not in (0, len(mounts)) or _contradicts(recorded, states):
            found.notes.append(f"{path}: a record of another run, not used")
            continue
        found.mounts = mounts
        # A recorder that retries after a full disk repeats some frames.
        frames |= recorded
    for epoch in epochs:
        found.readings += _of_states(epoch, frames)
    if frames:
        offset_ns = states[0][0] - states[0][1].stamp_ns
        found.readings += _of_frames(frames.values(), count, offset_ns)
    found.readings.sort(key=attrgetter("stamp_ns"))
    return found


def _epochs(states: Sequence[tuple[int, LoggedState]]) -> list[list[tuple[int, LoggedState]]]:
    """Return the stretches of states with continuous times of both the robot and the log."""
    epochs: list[list[tuple[int, LoggedState]]] = []
    before: tuple[int, int] | None = None
    for log_ns, state in states:
        offset_ns = log_ns - state.stamp_ns
        if before is None or before[0] != offset_ns or before[1] > state.stamp_ns:
            epochs.append([])
        epochs[-1].append((log_ns, state))
        before = offset_ns, state.stamp_ns
    return epochs


def _record(
    path: Path, notes: list[str], *, with_frames: bool
) -> tuple[tuple[SonarMount, ...], _Frames] | None:
    """Return the sonar mounting from a record, and its frames up to its end or damage."""
    frames: _Frames = {}
    with path.open("rb") as file:
        try:
            header, entries = read_record(file, str(path))
            mounts = msgspec.convert(json.loads(header.robot_json), _Robot).sonar
        except (RecordError, msgspec.ValidationError, json.JSONDecodeError) as error:
            notes.append(
                f"the record of the control loop cannot be read: {error}; sonar ranges are those "
                "of the states"
            )
            return None
        try:
            for entry in entries if with_frames else ():
                if isinstance(entry, Tick):
                    for frame in entry.inputs.feedback.sonars:
                        frames[frame.stamp_ns, frame.first] = frame
        except RecordError as error:
            notes.append(f"{error}; from there on sonar ranges are those of the states")
    return mounts, frames


def _contradicts(frames: _Frames, states: Sequence[tuple[int, LoggedState]]) -> bool:
    """Whether a record lacks most of the states' readings, so that it is of another run."""
    if not frames:
        return False
    begin_ns, end_ns = min(frames)[0], max(frames)[0]
    first = bisect_left(states, begin_ns, key=_stamp_ns)
    same = [
        _range_in_frames(frames, stamp_ns, index) == range_m
        for _, state in states[first : bisect_right(states, end_ns, key=_stamp_ns)]
        for index, (stamp_ns, range_m) in enumerate(
            zip(state.sonar_stamp_ns, state.sonar_m, strict=True)
        )
        if stamp_ns >= begin_ns and not math.isnan(range_m)
    ]
    return 2 * sum(same) < len(same)


def _stamp_ns(state: tuple[int, LoggedState]) -> int:
    """Return the robot's time."""
    return state[1].stamp_ns


def _range_in_frames(frames: _Frames, stamp_ns: int, index: int) -> float | None:
    """Return the range of a sonar received at a time [m]; None if no frame has it."""
    frame = frames.get((stamp_ns, index - index % _IN_FRAME))
    return None if frame is None else frame.ranges_m[index % _IN_FRAME]


def _of_states(epoch: Sequence[tuple[int, LoggedState]], frames: _Frames) -> Iterator[SonarReading]:
    """Yield readings that are new in each state and in no record."""
    news = NewSonarReadings(_REACH_M)
    for log_ns, state in epoch:
        stamps_ns = [
            stamp_ns if _range_in_frames(frames, stamp_ns, index) is None else 0
            for index, stamp_ns in enumerate(state.sonar_stamp_ns)
        ]
        for sent_ns, heard in news.take(state.stamp_ns, stamps_ns, state.sonar_m):
            yield SonarReading(sent_ns + log_ns - state.stamp_ns, heard)


def _of_frames(
    frames: Iterable[SonarFeedback], count: int, offset_ns: int
) -> Iterator[SonarReading]:
    """Yield the ranges of each frame, of `count` sonars."""
    for frame in frames:
        heard = [math.nan] * count
        own = frame.ranges_m[: max(count - frame.first, 0)]
        heard[frame.first : frame.first + len(own)] = own
        if not all(map(math.isnan, heard)):
            sent_ns = frame.stamp_ns - listening_ns(heard, _REACH_M)
            yield SonarReading(sent_ns + offset_ns, tuple(heard))
