"""The files of one run of a recording, complete ones, whatever ended it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.summary import Summary

from robotctl.logs.mcap.recovery import McapLogError, is_complete, recover
from robotctl.words import counted
from robotctl.workbench.logs.rows import RecordingError, log_files, state_logs

PAUSE_NS: Final = 60_000_000_000
"""Time without a message between two files of a folder that are of two runs [ns]."""
_FLUSH_NS: Final = 2_000_000_000
"""Time by which messages are logged in another order than that of their stamps [ns]."""


@dataclass(frozen=True, slots=True)
class LogFile:
    """File that can be read, which is a completed copy of one that was cut.

    Parameters
    ----------
    name
        Path of the recorded file.
    path
        File to read.
    summary
        Its index.
    """

    name: Path
    path: Path
    summary: Summary

    @property
    def begun_ns(self) -> int:
        """Time by which it had begun [ns]: its first message may be a map that is much older."""
        return min(each.message_end_time for each in self.summary.chunk_indexes)

    @property
    def end_ns(self) -> int:
        """Time of its last message [ns]."""
        return self.summary.statistics.message_end_time if self.summary.statistics else 0


def files_of(run: Path, note: Callable[[str], None], stack: ExitStack) -> list[LogFile]:
    """Return the files of a recording, of a folder with several runs those of its last one.

    Parameters
    ----------
    run
        Folder of `--record`, or one `robot-*.mcap`.
    note
        Takes sentences on what was left out.
    stack
        Removes copies of files that were cut when it is closed.

    Raises
    ------
    RecordingError
        If it is no recording, or nothing in it can be read.
    OSError
        If a file cannot be read.
    """
    there = log_files(run)
    full = [each for each in there if each.stat().st_size]
    if not full:
        raise RecordingError(f"{there[0]}: is empty: nothing was recorded")
    for each in full:
        state_logs(each)
    files = []
    for name in full:
        try:
            file = _opened(name, note, stack)
        except (McapError, McapLogError) as error:
            if len(full) == 1:
                raise RecordingError(f"{name}: cannot be read: {error}") from error
            note(f"{name}: cannot be read, left out: {error}")
            continue
        if file.summary.statistics is not None and file.summary.statistics.message_count:
            files.append(file)
    runs = _runs(files)
    if not runs:
        raise RecordingError(f"{run}: no message in it")
    if len(runs) > 1:
        others = ", ".join(str(each[0].name) for each in runs[:-1])
        note(
            f"{run} holds {counted(len(runs), 'run')}; this is the last; the others begin with "
            f"{others}"
        )
    return runs[-1]


def _opened(name: Path, note: Callable[[str], None], stack: ExitStack) -> LogFile:
    """Return a file with its index; one without is completed as a copy."""
    path = name
    summary = _summary(path) if is_complete(path) else None
    if summary is None:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="robotctl-view-"))
        path = Path(folder) / name.name
        shutil.copyfile(name, path)
        recovered = recover(path)
        path = Path(folder) / name.name
        lost = ", parts of it damaged" if recovered.kept_aside else ""
        note(f"{name}: was not closed{lost}; shown is what stands whole in it")
        summary = _summary(path)
    if summary is None:
        raise McapLogError("no index in it")
    return LogFile(name, path, summary)


def _summary(path: Path) -> Summary | None:
    """Return the index of a file; None: it has none, or not a whole one."""
    with path.open("rb") as file:
        try:
            found = make_reader(file).get_summary()
        except (McapError, ValueError, EOFError):
            return None
    return found if found is not None and found.chunk_indexes else None


def _runs(files: Sequence[LogFile]) -> list[list[LogFile]]:
    """Return the files of each run, in their order."""
    runs: list[list[LogFile]] = []
    for file in files:
        before = runs[-1][-1] if runs else None
        if before is None or not -_FLUSH_NS <= file.begun_ns - before.end_ns <= PAUSE_NS:
            runs.append([])
        runs[-1].append(file)
    return runs
