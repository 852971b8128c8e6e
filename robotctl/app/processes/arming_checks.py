"""What of the host computer speaks against arming."""

from __future__ import annotations

from pathlib import Path


class Fitness:
    """Gives the host's objections when somebody asks to arm.

    Make it before the files are read: what changes between its making and their reading then shows
    as well.

    Parameters
    ----------
    files
        What the running configuration was read from.
    """

    def __init__(self, *files: Path) -> None:
        self.refused_rights: tuple[str, ...] = ()
        """Real-time rights that the machine refused, where the robot may not do without."""
        self._files = {file: (_mark(file), _content(file)) for file in files}

    def objections(self) -> tuple[str, ...]:
        """Return one sentence for each objection; a few system calls where nothing changed."""
        rights = tuple(
            f"real-time right missing: {sentence} (or set runtime.allow_best_effort)"
            for sentence in self.refused_rights
        )
        changed = tuple(
            f"{file} is not what it was when it was read: restart to use it"
            for file, (mark, content) in self._files.items()
            if _mark(file) != mark and _content(file) != content
        )
        return rights + changed


def _mark(file: Path) -> tuple[int, int, int] | None:
    """Return what every write to a file changes; None where it cannot be read."""
    try:
        status = file.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def _content(file: Path) -> bytes | None:
    """Return what is in a file; None where it cannot be read."""
    try:
        return file.read_bytes()
    except OSError:
        return None
