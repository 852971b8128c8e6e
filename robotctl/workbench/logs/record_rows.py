"""A record of the control loop as rows of tables: inputs, outputs and states of each tick."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final, TypeAlias

import msgspec

from robotctl.app.processes.robot import make_core
from robotctl.logs.mcap.forms import control_content
from robotctl.logs.mcap.schema import plain
from robotctl.logs.mcap.table import Row, rows_of
from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback
from robotctl.messages.control import Feedback, LoopStatistics, SonarFeedback
from robotctl.runtime.flight.recorder import (
    Entry,
    RecordError,
    RecordHeader,
    ReplayedStep,
    Tick,
    is_cut,
    read_record,
    replay_steps,
)
from robotctl.workbench.replay.replay import robot_of

TopicRow: TypeAlias = tuple[str, int, Row]
"""Topic, time [ns], and the values by column."""

_EVENTS: Final = ("battery", "gyro", "accelerometer")
"""Parts of the feedback that are new in a tick that has them."""

_NO_FIGURES: Final = LoopStatistics()


def record_rows(file: Path, notes: list[str], topics: Collection[str] | None) -> Iterator[TopicRow]:
    """Yield inputs and outputs of each tick, and the resulting states.

    Times are those of the logs; in a record of an older version they are the robot's own.

    Parameters
    ----------
    file
        The record.
    notes
        Sentences on what could not be had are added here.
    topics
        Others are passed over; None: all are wanted.

    Raises
    ------
    RecordError
        If it is no record.
    OSError
        If it cannot be read.
    """
    with file.open("rb") as source:
        header, entries = read_record(source, str(file))
        names = _sonar_names(header)
        known: tuple[ActuatorFeedback, ...] = ()
        for entry in _up_to_damage(entries, notes):
            if isinstance(entry, Tick):
                before, known = known, entry.inputs.feedback.actuators
                news = () if known == before else _of_actuators(known)
                for topic, stamp_ns, row in chain(news, _of_tick(entry, names)):
                    if topics is None or topic in topics:
                        yield topic, stamp_ns + header.epoch_ns, row
        if is_cut(source):
            notes.append(f"{file}: was cut short, read up to there")
    if topics is None or "control" in topics:
        yield from _computed(file, notes)


def _up_to_damage(entries: Iterator[Entry], notes: list[str]) -> Iterator[Entry]:
    """Yield the entries up to the first that is damaged, which is noted."""
    try:
        yield from entries
    except RecordError as error:
        notes.append(f"{error}; read up to there")


def _of_tick(tick: Tick, sonar_names: Sequence[str]) -> Iterator[TopicRow]:
    """Yield inputs and outputs of one tick, each at its own time."""
    feedback, outputs = tick.inputs.feedback, tick.outputs
    done = {"lag_ns": tick.lag_ns, "step_ns": tick.step_ns, "command": plain(outputs.command)}
    stop = outputs.emergency_stop
    asked = {} if stop is None else {"emergency_stop": stop}
    yield from _rows(
        "tick",
        tick.now_ns,
        {**done, **asked, "clear_faults": outputs.clear_faults, "bus": plain(feedback.bus)},
    )
    yield from _of_feedback(feedback, sonar_names)
    for request in tick.inputs.requests:
        kind = {"request": type(request).__name__}
        yield from _rows("request", tick.now_ns, {**kind, **plain(request)})
    for notice in outputs.notices:
        yield from _rows("notice", notice.stamp_ns, plain(notice))


def _of_actuators(reports: Sequence[ActuatorFeedback]) -> Iterator[TopicRow]:
    """Yield a row of what all actuators told last, at the time when the newest of it came."""
    content: dict[str, object] = {}
    newest_ns = NEVER_NS
    for place, report in enumerate(reports):
        newest_ns = max(newest_ns, report.motion_ns, report.report_ns, report.supply_ns)
        content |= {f"{key}[{place}]": value for key, value in plain(report).items()
                    if not key.endswith("_ns")}  # fmt: skip
    if newest_ns != NEVER_NS:
        yield from _rows("actuators", newest_ns, content)


def _of_feedback(feedback: Feedback, sonar_names: Sequence[str]) -> Iterator[TopicRow]:
    """Yield the rows of messages from the bus."""
    for topic in _EVENTS:
        message = getattr(feedback, topic)
        if message is not None:
            yield from _rows(topic, message.stamp_ns, plain(message))
    for frame in feedback.sonars:
        yield from _rows("sonars", frame.stamp_ns, _ranges(frame, sonar_names))
    for emergency in feedback.emergencies:
        yield from _rows("emergency", emergency.stamp_ns, plain(emergency))


def _ranges(frame: SonarFeedback, sonar_names: Sequence[str]) -> dict[str, object]:
    """Return the ranges of a frame, by the name of each sonar; nan is missing."""
    names = sonar_names[frame.first :]
    return {
        f"range_m[{name}]": range_m
        for name, range_m in zip(names, frame.ranges_m, strict=False)
        if not math.isnan(range_m)
    }


def _sonar_names(header: RecordHeader) -> list[str]:
    """Return the names of the sonars, whatever else the configuration says."""
    return [str(each.get("name")) for each in json.loads(header.robot_json).get("sonar", ())]


def _rows(topic: str, time_ns: int, content: dict[str, Any]) -> Iterator[TopicRow]:
    """Yield the rows of a message that is not from JSON."""
    for row in rows_of(msgspec.to_builtins(content)):
        yield topic, time_ns, row


def _computed(file: Path, notes: list[str]) -> Iterator[TopicRow]:
    """Yield the state of the controller after each tick."""
    encode = msgspec.msgpack.Encoder().encode
    is_same = True
    try:
        with file.open("rb") as source:
            header, entries = read_record(source, str(file))
            config, options = robot_of(header, file)
            names = [mount.name for mount in config.sonar]
            steps = replay_steps(
                lambda: make_core(config, options), entries, str(file), header.fields
            )
            for step in steps:
                if is_same and encode(step.outputs) != encode(step.tick.outputs):
                    is_same = False
                    notes.append(
                        f"{file}: topic control is recomputed and differs from tick {step.number} "
                        "on: the record is of another robotctl"
                    )
                yield from _state_of(step, names, header.epoch_ns)
    except RecordError as error:
        notes.append(f"topic control, which is recomputed, ends: {error}")


def _state_of(step: ReplayedStep, names: list[str], epoch_ns: int) -> Iterator[TopicRow]:
    """Yield the state after a step."""
    now_ns = step.tick.now_ns
    content = control_content(step.core.snapshot(now_ns, _NO_FIGURES), names)
    for missing in ("loop", "odometer_m"):  # neither is in a record
        content.pop(missing, None)
    yield from _rows("control", now_ns + epoch_ns, content)
