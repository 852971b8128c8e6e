"""Files that appear only when complete; until then they are `NAME.part`, locked by the writer."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Final

from robotctl.runtime.storage.ring_file import hold, remove_dead

_PART: Final = ".part"


@contextmanager
def part_file(target: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces its target once complete and on the disk.

    If that fails it is removed, and the target stays unchanged.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    part = target.with_name(f"{target.name}{_PART}")
    try:
        with part.open("wb") as file:
            hold(file)
            yield file
            file.flush()
            os.fsync(file.fileno())
            part.replace(target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_whole(target: Path, content: str | bytes) -> None:
    """Write a file atomically, readable for all users.

    Raises
    ------
    OSError
        If it cannot be written; the old file stays.
    """
    with part_file(target) as file:
        file.write(content.encode() if isinstance(content, str) else content)
        os.fchmod(file.fileno(), 0o644)


def remove_parts(folder: Path, pattern: str) -> None:
    """Remove temporary files left by dead writers of targets like `pattern`."""
    for path in folder.glob(f"{pattern}{_PART}"):
        with suppress(OSError):  # its writer just ended, or it may not be removed
            remove_dead(path)
