"""A folder of logs, bounded in size: files of one kind are numbered, the oldest go first.

A log is locked while it is written, and clean-up leaves it alone.
"""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO, Final

from robotctl.errors import InvalidValue, RobotctlError
from robotctl.runtime.storage.ring_file import hold, leads_to, remove_dead

MOST_TOTAL_MB: Final = 1e9

_LOG: Final = re.compile(
    r"(control|can|robot|simulator|truth)-(\d{4,})\.(rec|log|mcap|tum)(?:\.damaged-\d+)?"
)
_NUMBERED: Final = re.compile(rf"{_LOG.pattern}|(map)-(\d{{4,}})\.yaml")
_OF_THE_RECORDER: Final = ("control", "can", "robot")


class LogError(RobotctlError):
    """A log cannot be written or read."""


@dataclass(frozen=True, slots=True)
class LogConfig:
    """Size limits of logs.

    Parameters
    ----------
    file_mb
        Size of a file above which a new one begins [MB].
    total_mb
        Total size of the folder's logs above which the oldest are removed [MB], ten times `file_mb`
        to 1e9.
    pictures_every_s
        Time between stored pictures of an enabled camera [s], 0.2 to 3600; 0: none are stored.
    """

    file_mb: float = 64.0
    total_mb: float = 2000.0
    pictures_every_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.file_mb <= 4000.0:
            raise InvalidValue(
                "file_mb", f"must be above 0 and at most 4000, not {self.file_mb}", self.file_mb
            )
        if not 10.0 * self.file_mb <= self.total_mb <= MOST_TOTAL_MB:
            raise InvalidValue(
                "total_mb",
                f"must be at least ten times file_mb ({10 * self.file_mb:g}) and at most "
                f"{MOST_TOTAL_MB:g}, not {self.total_mb}",
                self.total_mb,
            )
        every_s = self.pictures_every_s
        if every_s != 0.0 and not 0.2 <= every_s <= 3600.0:
            raise InvalidValue(
                "pictures_every_s", f"must be 0 (none) or 0.2 to 3600, not {every_s}", every_s
            )


def make_folder(directory: Path) -> None:
    """Make a folder of logs and its parents, if missing.

    Raises
    ------
    LogError
        If it cannot be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise LogError(f"{directory}: is not a folder") from error
    except OSError as error:
        raise LogError(f"{directory}: cannot be created: {error.strerror}") from error


def age_rank(status: os.stat_result) -> tuple[bool, int]:
    """Return a sort key that puts the oldest file first.

    A file dated in the future was written before the clock was set back, as at each start of a
    computer without a battery: it is older than everything written since.
    """
    return status.st_mtime_ns <= time.time_ns(), status.st_mtime_ns


def refusal(directory: Path) -> str:
    """Return why no file can be written in a folder; empty if one can."""
    try:
        with tempfile.TemporaryFile(dir=directory):
            return ""
    except OSError as error:
        return f"{directory}: cannot be written: {error.strerror}"


class LogFolder:
    """Names new log files and removes old ones.

    Parameters
    ----------
    directory
        Folder of the logs, made if missing.
    config
        Size limits.

    Raises
    ------
    LogError
        If the directory cannot be made.
    """

    def __init__(self, directory: Path, config: LogConfig) -> None:
        self.directory = directory
        self.file_bytes = round(config.file_mb * 1e6)
        self.total_bytes = round(config.total_mb * 1e6)
        make_folder(directory)

    def new(self, kind: str, suffix: str) -> Path:
        """Return the path of a new file, such as `control-0002.rec`, after making room."""
        self.trim()
        return self.directory / f"{kind}-{self._next(kind):04d}.{suffix}"

    def pictures(self) -> Path:
        """Return the folder for pictures of a run whose first log of states is still missing."""
        return self.directory / f"pictures-{self._next('robot'):04d}"

    def open(self, kind: str, suffix: str) -> BinaryIO:
        """Open a new file, such as `control-0002.rec`, locked until it is closed.

        Raises
        ------
        OSError
            If the disk refuses.
        """
        while True:
            path = self.new(kind, suffix)
            file = path.open("wb")
            hold(file)
            if leads_to(path, file.fileno()):  # not removed as empty before it was locked
                return file
            file.close()

    def begin_run(self) -> int:
        """Return the number of a simulated run, shared by its first log of states, truth and map.

        An empty truth file reserves it, and stays if the run is interrupted, so that its logs are
        not mistaken for those of the previous run.

        Raises
        ------
        OSError
            If the disk refuses.
        """
        run = 1 + max(map(self._last, ("robot", "truth", "map")))
        (self.directory / f"truth-{run:04d}.tum").touch(exist_ok=False)
        return run

    def _next(self, kind: str) -> int:
        """Return the number of the next file of one kind."""
        number = self._last(kind) + 1
        return max(number, self._last("truth")) if kind == "robot" else number

    def _last(self, kind: str) -> int:
        """Return the highest number of the files of one kind; 0 without any."""
        matches = (_NUMBERED.fullmatch(path.name) for path in self.directory.iterdir())
        return max((int(m[2] or m[5]) for m in matches if m and kind in (m[1], m[4])), default=0)

    def remove_empty(self) -> None:
        """Remove empty logs of the recorder, left by a full disk."""
        for path in self.directory.iterdir():
            match = _LOG.fullmatch(path.name)
            if match and match[1] in _OF_THE_RECORDER:
                _remove_if_empty(path)

    def trim(self, keep: Collection[Path] = ()) -> None:
        """Remove the oldest logs until the rest is within the limit.

        Logs in `keep` stay, and so do those being written.
        """
        files = []
        for path in self.directory.iterdir():
            if _LOG.fullmatch(path.name):
                status = path.stat()
                files.append((age_rank(status), path.name, path, status.st_size))
        total = sum(size for *_, size in files)
        for *_, path, size in sorted(files):
            if total <= self.total_bytes:
                return
            if path not in keep and _removed(path):
                total -= size


def is_gone(file: IO[Any]) -> bool:
    """Return whether a log being written was deleted, so that further writing is useless."""
    return not leads_to(Path(file.name), file.fileno())


def close_log(file: IO[Any]) -> None:
    """Close a log and remove it if empty, as on a full disk.

    Raises
    ------
    OSError
        If the disk refuses the rest of the data; the file is closed nevertheless.
    """
    try:
        file.close()
    finally:
        _remove_if_empty(Path(file.name))


def _remove_if_empty(path: Path) -> None:
    """Remove an empty file that is not being written; ignore a refusal."""
    with suppress(OSError):
        if path.stat().st_size == 0:
            _removed(path)


def _removed(path: Path) -> bool:
    """Remove a log unless it is being written; return whether it is gone."""
    try:
        remove_dead(path)
    except OSError:  # a disk without locks, or one that refuses this, too
        path.unlink(missing_ok=True)
    return not path.exists()
