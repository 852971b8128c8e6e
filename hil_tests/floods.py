"""Keeps floods of a simulated bus away from tests that need the rest of the processors.

Under a flood the simulator takes three quarters of a processor, before all else. Two of them, or
one beside four other robots, leave nothing for a second to the processes that have no priority: a
navigation that stands for so long lets the robot hold, as it must. The locks are files, so that
tests in other processes on this machine are kept away, too.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path


def flood() -> AbstractContextManager[None]:
    """Be the only one: no other flood, nobody in `calm`."""
    return _held(fcntl.LOCK_EX)


def calm() -> AbstractContextManager[None]:
    """Be with others, but with no flood."""
    return _held(fcntl.LOCK_SH)


@contextmanager
def _held(mode: int) -> Iterator[None]:
    """Hold the lock; who waits for it holds the gate, so that no later one comes before."""
    name = f"robotctl-{os.getuid()}"
    folder = Path(tempfile.gettempdir())
    gate_path, lock_path = folder / f"{name}-gate.lock", folder / f"{name}-flood.lock"
    with gate_path.open("wb") as gate, lock_path.open("wb") as lock:
        fcntl.flock(gate, fcntl.LOCK_EX)
        fcntl.flock(lock, mode)
        fcntl.flock(gate, fcntl.LOCK_UN)
        yield
