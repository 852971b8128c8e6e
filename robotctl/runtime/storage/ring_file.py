"""Owner of a flight ring or log (its writer's lock), and the place for a dead process's ring.

A ring is locked by its writer for the writer's lifetime. Before renaming or removing one, lock it,
then check that the path still leads to the locked file: another process may have replaced it in
between. So the ring of a live process is never removed.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Final

from robotctl.errors import LinkError

MOST_DEAD: Final = 4
"""Maximum rings kept of processes that crashed together with their recorder."""

_PROBES: Final = 50
_PROBE_S: Final = 0.002
"""Wait of a writer for a probe, which locks a ring for some microseconds [s]."""


def crashed(path: Path) -> Path:
    """Return the path to which the ring of a process that crashed is moved."""
    return path.with_name(f"{path.name}.crashed")


def is_written(path: Path) -> bool:
    """Return whether a live process writes a file, by the lock on it."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def hold(file: IO[Any]) -> bool:
    """Lock a file while it is open; return whether no other process has locked it.

    A disk without locks, as in some networks, counts as success.
    """
    try:
        return _locked(file.fileno())
    except OSError:
        return True


def leads_to(path: Path, descriptor: int) -> bool:
    """Return whether a path leads to an open file, not to its replacement."""
    try:
        there = path.stat()
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))


def new_locked(path: Path) -> int:
    """Return the descriptor of a locked, empty file at a path, replacing a dead process's ring.

    Raises
    ------
    LinkError
        If another process writes it.
    OSError
        If it cannot be made.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            if not _locked(descriptor):
                raise LinkError(f"{path}: another process writes it")
            if leads_to(path, descriptor):
                if os.fstat(descriptor).st_size == 0:
                    return os.dup(descriptor)  # the lock is on both
                path.replace(crashed(path))
        finally:
            os.close(descriptor)


def retire(path: Path) -> None:
    """Move the ring of a dead process to `crashed(path)`; that of a live one stays.

    Raises
    ------
    OSError
        If it cannot be moved.
    """
    with _dead(path) as descriptor:
        if descriptor is None:
            return
        if os.fstat(descriptor).st_size == 0:  # just being created, or never completed
            path.unlink()
        else:
            path.replace(crashed(path))


def remove_dead(path: Path) -> None:
    """Remove a file unless its writer lives.

    Raises
    ------
    OSError
        If it cannot be removed.
    """
    with _dead(path) as descriptor:
        if descriptor is not None:
            path.unlink()


def remove_old(folder: Path) -> None:
    """Remove all but the newest ring of dead processes: nothing else frees their memory."""
    dead = []
    for path in folder.glob("*.ring*"):
        with suppress(FileNotFoundError):  # others do the same
            if not is_written(path):
                dead.append((path.stat().st_mtime_ns, path))
    for _, path in sorted(dead)[:-MOST_DEAD]:
        remove_dead(path)


def _locked(descriptor: int) -> bool:
    """Lock a file that only a probe may have locked; return whether that succeeded."""
    for _ in range(_PROBES):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(_PROBE_S)
        else:
            return True
    return False


@contextmanager
def _dead(path: Path) -> Iterator[int | None]:
    """Hold the lock of the file at a path; None if it is missing, or its writer lives."""
    descriptor = _lock_dead(path)
    try:
        yield descriptor
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock_dead(path: Path) -> int | None:
    """Lock the file at a path; None if it is missing, or its writer lives."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except FileNotFoundError:
            return None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            if isinstance(error, BlockingIOError):
                return None
            raise
        if leads_to(path, descriptor):
            return descriptor
        os.close(descriptor)
