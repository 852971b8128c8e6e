"""A recording as CSV, one file a topic, for spreadsheets and pandas.

Commas between the columns, points in the numbers, UTF-8. An empty cell is a value that is missing,
`inf` one that is infinite, 1 and 0 are true and false.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from robotctl.app.log_rows import RecordingError, log_files, log_rows
from robotctl.telemetry.log_table import Cell, Row, header_of

TIMES: Final = ("time_s", "run_s")
"""By the wall clock, as in all logs, and since the first entry of the recording."""

_TOLD: Final = 5_000


@dataclass(frozen=True, slots=True)
class TopicFile:
    """A file that was written."""

    path: Path
    rows: int
    columns: int


@dataclass(slots=True)
class _Topic:
    """What is known of a topic before it is written."""

    columns: list[str] = field(default_factory=list)
    known: set[str] = field(default_factory=set)
    rows: int = 0

    def add(self, row: Row) -> None:
        """Learn the columns of a row; one that is new comes behind the one before it there."""
        self.rows += 1
        if self.known.issuperset(row):
            return
        place = 0
        for column in row:
            if column in self.known:
                place = self.columns.index(column) + 1
            else:
                self.columns.insert(place, column)
                self.known.add(column)
                place += 1


@dataclass(frozen=True, slots=True)
class Exported:
    """What became of an export; `notes` say what of the recording could not be read."""

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
    files, notes = log_files(run), list[str]()
    topics: dict[str, _Topic] = {}
    first_ns = None
    count = 0
    for file in files:
        for topic, time_ns, row in log_rows(file, notes):
            topics.setdefault(topic, _Topic()).add(row)
            first_ns = time_ns if first_ns is None else min(first_ns, time_ns)
            count += 1
            if count % _TOLD == 0:
                tell(count, 2 * count)
    if first_ns is None:
        raise RecordingError(f"{run}: nothing is in it")
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        writers = {
            topic: _writer(stack, folder / f"{topic}.csv", known) for topic, known in topics.items()
        }
        done = count
        for file in files:
            for topic, time_ns, row in log_rows(file, []):
                values = map(_text, map(row.get, topics[topic].columns))
                writers[topic]((_seconds(time_ns), _seconds(time_ns - first_ns), *values))
                done += 1
                if done % _TOLD == 0:
                    tell(done, 2 * count)
    return Exported(
        tuple(
            TopicFile(folder / f"{topic}.csv", known.rows, len(TIMES) + len(known.columns))
            for topic, known in sorted(topics.items())
        ),
        tuple(notes),
    )


def _writer(stack: ExitStack, path: Path, topic: _Topic) -> Callable[[Any], Any]:
    """Return what writes a row of a new file, whose heading is written."""
    file = stack.enter_context(path.open("w", encoding="utf-8", newline=""))
    write: Callable[[Any], Any] = csv.writer(file, lineterminator="\n").writerow
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
