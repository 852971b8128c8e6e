"""Numbers of a recording over time, for plots and summaries, with its gaps and restarts."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.mcap.table import Cell, unit_of
from robotctl.messages.control import SafetyState
from robotctl.workbench.logs.rows import (
    TOLD,
    RecordingError,
    Survey,
    log_files,
)

_CONTROL: Final = "control"
_STATE, _TICKS, _DISTANCE = "state", "loop.ticks", "distance_m"
_GAP_PERIODS: Final = 5.0
_STATES: Final = frozenset(each.value for each in SafetyState)
_LEAST_GAP_S: Final = 0.5
"""Silence that counts as a gap, in time and in usual periods of the topic."""


@dataclass(frozen=True, slots=True)
class Series:
    """One field of a topic over time.

    Parameters
    ----------
    name
        `TOPIC.FIELD`.
    unit
        Empty if it has none.
    time_s
        Since the first entry of the recording, (n,) [s].
    values
        (n,); nan if a message lacks it and once in each gap, inf as logged.
    messages
        How many there are.
    gaps
        Begin and end of each time without messages [s].
    """

    name: str
    unit: str
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    messages: int
    gaps: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Stretch:
    """The robot was in one state from `begin_s` to `end_s` [s]."""

    state: SafetyState
    begin_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Selection:
    """Requested parts of a recording.

    Parameters
    ----------
    series
        In the order in which they were asked for.
    stretches
        States of the robot; empty if no topic tells them.
    restarts_s
        When the control process had restarted [s].
    notes
        Sentences on what could not be read.
    """

    series: tuple[Series, ...]
    stretches: tuple[Stretch, ...]
    restarts_s: tuple[float, ...]
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Columns:
    """Some columns of one topic, and the times of its rows [ns]."""

    times_ns: list[int] = field(default_factory=list)
    cells: dict[str, list[Cell | None]] = field(default_factory=dict)


def select(run: Path, fields: Sequence[str], tell: Callable[[int, int], None]) -> Selection:
    """Read some fields of a recording.

    Parameters
    ----------
    run
        The recording.
    fields
        `TOPIC.FIELD` each. `control.duty` means all of `control.duty[0]` and so on, but for texts
        and times; in place of brackets there may be dots.
    tell
        Called with how many entries are read, and how many there are twice: the first time to learn
        the columns.

    Raises
    ------
    RecordingError
        If it is no recording, or has not such a field; names the nearest.
    OSError
        If it cannot be read.
    """
    files = log_files(run)
    topics = {name.partition(".")[0] for name in fields} | {_CONTROL}
    survey = Survey.of(files, lambda done: tell(done, 2 * done), topics)
    wanted = dict.fromkeys(each for name in fields for each in _matching(run, name, survey, files))
    found = {topic: _Columns() for topic in survey.topics}
    for topic, column in wanted:
        found[topic].cells[column] = []
    if _CONTROL in found:
        found[_CONTROL].cells |= {each: [] for each in (_STATE, _TICKS, _DISTANCE)}
    for done, (topic, time_ns, row) in enumerate(survey.rows_again(files, topics), survey.count):
        found[topic].times_ns.append(time_ns)
        for column, cells in found[topic].cells.items():
            cells.append(row.get(column))
        if done % TOLD == 0:
            tell(done, 2 * survey.count)
    times_s: dict[str, NDArray[np.float64]] = {
        topic: np.array([1e-9 * (each - survey.first_ns) for each in columns.times_ns])
        for topic, columns in found.items()
    }
    begins, stretches = [], []
    if _CONTROL in found:
        begins = _begins(found[_CONTROL])
        stretches = _stretches(found[_CONTROL].cells[_STATE], times_s[_CONTROL], begins)
    return Selection(
        tuple(
            _series(
                f"{topic}.{column}",
                times_s[topic],
                found[topic].cells[column],
                begins if topic == _CONTROL else (),
            )
            for topic, column in wanted
        ),
        tuple(stretches),
        tuple(float(times_s[_CONTROL][index]) for index in begins),
        tuple(survey.notes),
    )


def _plain(column: str) -> str:
    """Return the name of a column with dots in place of brackets."""
    return column.replace("[", ".").replace("]", "")


def _matching(run: Path, name: str, survey: Survey, files: Sequence[Path]) -> list[tuple[str, str]]:
    """Return the topic and the columns that a name means."""
    topic, _, wanted = name.partition(".")
    if topic not in survey.topics:
        everything = Survey.of(files, lambda _: None)
        if not everything.topics:
            raise RecordingError(f"{run}: nothing is in it")
        raise RecordingError(
            f"{name}: no topic {topic!r} in {run}{_near(topic, list(everything.topics))}; there "
            f"are {', '.join(sorted(everything.topics))}"
        )
    columns, texts = survey.topics[topic].columns, survey.topics[topic].texts
    wanted = _plain(wanted)
    exact = [each for each in columns if _plain(each) == wanted]
    if set(exact) & texts:
        raise RecordingError(f"{name}: is text, which has no plot; `robotctl record export` has it")
    found = exact or [
        each
        for each in columns
        if wanted
        and _plain(each).startswith(f"{wanted}.")
        and each not in texts
        and not each.endswith("_ns")
    ]
    if not found:
        near = _near(name, [f"{topic}.{each}" for each in columns if each not in texts])
        firsts = dict.fromkeys(_plain(each).partition(".")[0] for each in columns)
        raise RecordingError(
            f"{name}: no such field in {run}{near}; {topic} has {', '.join(firsts)}"
        )
    return [(topic, each) for each in found]


def _near(name: str, names: Sequence[str]) -> str:
    """Return a question for the nearest name, if possible one that ends as it does."""
    last = "." + _plain(name).rpartition(".")[2]
    alike = [each for each in names if _plain(each).endswith(last)]
    near = difflib.get_close_matches(name, alike or names, n=1, cutoff=0.0 if alike else 0.4)
    return f', did you mean "{near[0]}"?' if near else ""


def _begins(control: _Columns) -> list[int]:
    """Return the rows at which a control process restarted, or another run began."""
    times_ns, cells = control.times_ns, control.cells
    return [
        index
        for index in range(1, len(times_ns))
        if times_ns[index] < times_ns[index - 1]
        or any(_fell(cells[column], index) for column in (_TICKS, _DISTANCE))
    ]


def _fell(cells: Sequence[Cell | None], index: int) -> bool:
    """Whether a count that only grows is less than in the row before."""
    before, after = cells[index - 1], cells[index]
    is_counted = isinstance(before, int | float) and isinstance(after, int | float)
    return is_counted and float(after or 0) < float(before or 0)


def _breaks(time_s: NDArray[np.float64], begins: Sequence[int]) -> list[int]:
    """Return the rows before which there is a gap."""
    steps_s = np.diff(time_s)
    if not len(steps_s):
        return []
    longest_s = max(_LEAST_GAP_S, _GAP_PERIODS * float(np.median(steps_s)))
    silent = np.flatnonzero((steps_s > longest_s) | (steps_s < -longest_s)) + 1
    return sorted({*silent.tolist(), *begins})


def _stretches(
    states: Sequence[Cell | None], time_s: NDArray[np.float64], begins: Sequence[int]
) -> list[Stretch]:
    """Return the time spent in each state, without gaps."""
    found: list[Stretch] = []
    breaks = set(_breaks(time_s, begins))
    for index, state in enumerate(states):
        if not isinstance(state, int) or state not in _STATES:
            continue
        now_s = float(time_s[index])
        if found and index not in breaks:
            found[-1] = Stretch(found[-1].state, found[-1].begin_s, now_s)
            if found[-1].state == state:
                continue
        found.append(Stretch(SafetyState(state), now_s, now_s))
    return found


def _series(
    name: str, time_s: NDArray[np.float64], cells: Sequence[Cell | None], begins: Sequence[int]
) -> Series:
    """Return a column as numbers, with nan in its gaps."""
    values = np.array(
        [float(each) if isinstance(each, int | float) else math.nan for each in cells],
        dtype=np.float64,
    )
    breaks = _breaks(time_s, begins)
    return Series(
        name,
        unit_of(name.partition(".")[2]),
        np.insert(time_s, breaks, time_s[breaks]),
        np.insert(values, breaks, math.nan),
        len(time_s),
        tuple((float(time_s[index - 1]), float(time_s[index])) for index in breaks),
    )
