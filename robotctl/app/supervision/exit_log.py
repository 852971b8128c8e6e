"""A file with a line of JSON for each end and each pause of a process, bounded in size."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from robotctl.app.supervision.pause import Pause
from robotctl.app.supervision.supervised import Exit
from robotctl.runtime.storage.log_folder import make_folder

NAME: Final = "exits.jsonl"

MAX_BYTES: Final = 1_000_000
"""Size above which the file becomes `exits.jsonl.1`, replacing the previous one [bytes]."""


class ExitLog:
    """Appends to `exits.jsonl`; each line has reached the kernel when `write` returns.

    Parameters
    ----------
    directory
        Folder of the log, made if missing.

    Raises
    ------
    LogError
        If the directory cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        make_folder(directory)
        self._path = directory / NAME

    def write(self, ended: Exit | Pause, now: dt.datetime) -> str:
        """Append one end or pause at wall time `now`; return the error, empty if none."""
        known = {key: value for key, value in msgspec.to_builtins(ended).items() if value != ""}
        line = {"time": now.isoformat(timespec="milliseconds"), **known}
        try:
            if self._path.exists() and self._path.stat().st_size > MAX_BYTES:
                self._path.replace(self._path.with_name(NAME + ".1"))
            with self._path.open("ab", buffering=0) as file:
                size, data = file.tell(), msgspec.json.encode(line) + b"\n"
                if file.write(data) < len(data):  # half a line would spoil the next one
                    file.truncate(size)
                    return f"{self._path}: the end of {ended.name} is not logged: the disk is full"
        except OSError as error:
            return f"{self._path}: the end of {ended.name} is not logged: {error.strerror}"
        return ""

    def note(self, events: Sequence[Exit | Pause]) -> list[str]:
        """Append the latest events; return the errors."""
        now = dt.datetime.now().astimezone()
        return [trouble for each in events if (trouble := self.write(each, now))]
