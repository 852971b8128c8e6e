"""Everything that a recording holds, as rows of tables.

A recording is a folder of `--record`, one `robot-*.mcap` of it, or a record of the control loop: a
dump of the flight recorder or a `control-*.rec`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import Final

import msgspec

from robotctl.errors import RobotctlError
from robotctl.logs.formats.robotctl_log import is_mcap, json_messages, mcap_files
from robotctl.logs.mcap.table import Row, rows_of
from robotctl.runtime.flight.recorder import RecordError
from robotctl.workbench.logs.record_rows import TopicRow, record_rows

KINDS: Final = (
    "a folder of --record, a robot-*.mcap, or a record of the control loop (fault-*.rec, "
    "crash-*.rec, control-*.rec, or what `robotctl record dump` wrote)"
)
"""Readable files, for messages."""


TOLD: Final = 5_000
"""Entries between progress reports."""


class RecordingError(RobotctlError):
    """A recording cannot be read, or does not have the data requested."""


@dataclass(slots=True)
class TopicRows:
    """Columns of a topic in order, which of them are texts, and the number of rows."""

    columns: list[str] = field(default_factory=list)
    texts: set[str] = field(default_factory=set)
    rows: int = 0
    _known: set[str] = field(default_factory=set)

    def add(self, row: Row) -> None:
        """Add the columns of a row; a new one follows its predecessor in that row."""
        self.rows += 1
        if self._known.issuperset(row):
            return
        place = 0
        for column in row:
            if column in self._known:
                place = self.columns.index(column) + 1
            else:
                self.columns.insert(place, column)
                self._known.add(column)
                if isinstance(row[column], str):
                    self.texts.add(column)
                place += 1


@dataclass(slots=True)
class Survey:
    """Content of a recording.

    Parameters
    ----------
    topics
        By name.
    first_ns
        Time of the first entry [ns].
    count
        Entries.
    notes
        Sentences on what cannot be read.
    """

    topics: dict[str, TopicRows] = field(default_factory=dict)
    first_ns: int = 0
    count: int = 0
    notes: list[str] = field(default_factory=list)

    @staticmethod
    def of(
        files: Sequence[Path],
        tell: Callable[[int], None],
        topics: Collection[str] | None = None,
    ) -> Survey:
        """Read files once; see `log_rows`. `tell` is called with the entries so far."""
        found = Survey()
        for file in files:
            for topic, time_ns, row in log_rows(file, found.notes, topics):
                found.topics.setdefault(topic, TopicRows()).add(row)
                found.first_ns = min(found.first_ns, time_ns) if found.count else time_ns
                found.count += 1
                if found.count % TOLD == 0:
                    tell(found.count)
        return found

    def rows_again(
        self, files: Sequence[Path], topics: Collection[str] | None = None
    ) -> Iterator[TopicRow]:
        """Yield the same rows again; rows added meanwhile by a live run are left out."""
        rows = chain.from_iterable(log_rows(file, [], topics) for file in files)
        return islice(rows, self.count)


def log_files(run: Path) -> list[Path]:
    """Return the files of a recording, in their order.

    Raises
    ------
    RecordingError
        If it is none.
    """
    if not run.exists():
        raise RecordingError(f"{run}: no such file or folder; needed is {KINDS}")
    if not run.is_dir():
        return [run]
    files = mcap_files(run)
    if not files:
        records = sorted(run.glob("*.rec"))
        there = f"; give one of its records, such as {records[0]}" if records else ""
        raise RecordingError(f"{run}: no robot-*.mcap in it{there}. Needed is {KINDS}")
    return files


def state_logs(run: Path) -> list[Path]:
    """Return the logs of states of a recording, in their order.

    Raises
    ------
    RecordingError
        If it is none, or a record of the control loop.
    """
    files = log_files(run)
    for file in files:
        if not is_mcap(file):
            raise RecordingError(
                f"{file}: no log of states; give a folder of --record, or a robot-*.mcap of it"
            )
    return files


def log_rows(
    file: Path, notes: list[str], topics: Collection[str] | None = None
) -> Iterator[TopicRow]:
    """Yield the rows of a file, of some topics or of all.

    Parameters
    ----------
    file
        One of `log_files`.
    notes
        Sentences on what could not be read are added here.
    topics
        Others are passed over; None: all are wanted.

    Raises
    ------
    RecordingError
        If it is no recording, or a message of it cannot be read.
    OSError
        If it cannot be read.
    """
    if is_mcap(file):
        yield from _of_states(file, notes, topics)
        return
    try:
        yield from record_rows(file, notes, topics)
    except RecordError as error:
        raise RecordingError(
            f"{file}: neither an MCAP log nor a record of the control loop; needed is {KINDS}"
        ) from error


def _of_states(file: Path, notes: list[str], topics: Collection[str] | None) -> Iterator[TopicRow]:
    """Yield the messages of a log of states."""
    for topic, message in json_messages(file, notes):
        if topics is not None and topic not in topics:
            continue
        try:
            content = msgspec.json.decode(message.data)
            rows = list(rows_of(content))
        except (msgspec.DecodeError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise RecordingError(
                f"{file}: topic {topic}, message at {message.log_time} ns: {error}"
            ) from error
        for row in rows:
            yield topic, message.log_time, row
