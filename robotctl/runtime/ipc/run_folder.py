"""Removal of the shared memory of killed simulated runs.

Every process of a robot holds a shared lock on the folder of its sockets, which the kernel frees
when the process ends, however it ends. A folder that can be locked exclusively belongs to nobody.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Final

from robotctl.runtime.ipc.topics import endpoint_directory, endpoint_path, ring_folder, ring_name
from robotctl.runtime.storage.ring_file import crashed, leads_to

_PREFIX: Final = "sim-"
"""Prefix of instances that no later start uses; a real robot's files stay for its next start."""


def simulated_instance() -> str:
    """Return the instance name of the run that this process simulates."""
    return f"{_PREFIX}{os.getpid()}"


def hold_folder(instance: str) -> int:
    """Make and lock the folder of an instance's sockets; return the descriptor with the lock.

    Raises
    ------
    LinkError
        As for `endpoint_directory`.
    """
    while True:
        folder = endpoint_directory(instance)
        with suppress(FileNotFoundError):
            held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            fcntl.flock(held, fcntl.LOCK_SH)
            if leads_to(folder, held):
                return held
            os.close(held)  # removed in between, while no process held it


def remove_dead_runs() -> None:
    """Remove folders, clocks and flight rings of simulated runs without a live process."""
    for folder in endpoint_path("any").parent.glob(f"{_PREFIX}*"):
        with suppress(OSError):  # gone, or not ours
            held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remove(folder)
            finally:
                os.close(held)


def _remove(folder: Path) -> None:
    """Remove the files of a run; the folder last, since it leads to the rest."""
    ring = ring_folder() / ring_name(folder.name)
    for path in (ring, crashed(ring), ring.with_suffix(".clock")):
        path.unlink(missing_ok=True)
    shutil.rmtree(folder)
