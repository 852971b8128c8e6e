"""A recording as CSV, one file a topic, for spreadsheets and pandas.

As RFC 4180 has it, in UTF-8: commas between the columns, points in the numbers. An empty cell is a
value that is missing, `inf` one that is infinite; 1 and 0 are true and false.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from robotctl.logs.mcap.table import Cell, header_of
from robotctl.workbench.logs.rows import (
    TOLD,
    RecordingError,
    Survey,
    TopicRows,
    log_files,
)

TIMES: Final = ("time_s", "run_s")
"""Columns of time: by the wall clock, as in all logs, and since the first entry."""


@dataclass(frozen=True, slots=True)
class TopicFile:
    """A file that was written."""

    path: Path
    rows: int
    columns: int


@dataclass(frozen=True, slots=True)
class Exported:
    """Result of an export; `notes` name the parts of the recording that could not be read."""

    files: tuple[TopicFile, ...]
    notes: tuple[str, ...]


def export_csv(run: Path, folder: Path, tell: Callable[[int, int], None]) -> Exported:
    """Write `TOPIC.csv` for each topic of a recording; files of these names are replaced.

    Parameters
    ----------
    run
        The recording.
    folder
        Made where it is missing.
    tell
        Called with how many entries are read, and how many there are twice: the first time to learn
        the columns.

    Raises
    ------
    RecordingError
        If it is no recording, or an empty one.
    OSError
        If a file cannot be read or written.
    """
    files = log_files(run)
    survey = Survey.of(files, lambda done: tell(done, 2 * done))
    if not survey.topics:
        raise RecordingError(f"{run}: nothing is in it")
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        writers = {
            topic: _writer(stack, folder / f"{topic}.csv", known)
            for topic, known in survey.topics.items()
        }
        for done, (topic, time_ns, row) in enumerate(survey.rows_again(files), survey.count):
            values = map(_text, map(row.get, survey.topics[topic].columns))
            writers[topic]((_seconds(time_ns), _seconds(time_ns - survey.first_ns), *values))
            if done % TOLD == 0:
                tell(done, 2 * survey.count)
    return Exported(
        tuple(
            TopicFile(folder / f"{topic}.csv", known.rows, len(TIMES) + len(known.columns))
            for topic, known in sorted(survey.topics.items())
        ),
        tuple(survey.notes),
    )


def _writer(stack: ExitStack, path: Path, topic: TopicRows) -> Callable[[Any], Any]:
    """Return the function that writes a row of a new file, whose heading is written."""
    file = stack.enter_context(path.open("w", encoding="utf-8", newline=""))
    write: Callable[[Any], Any] = csv.writer(file).writerow
    write((*TIMES, *map(header_of, topic.columns)))
    return write


def _seconds(time_ns: int) -> str:
    """Return a time with all its nanoseconds [s]."""
    sign = "-" if time_ns < 0 else ""
    seconds, nanoseconds = divmod(abs(time_ns), 1_000_000_000)
    return f"{sign}{seconds}.{nanoseconds:09d}"


def _text(value: Cell | None) -> Cell:
    """Return how a value is written."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return int(value) if isinstance(value, bool) else value
