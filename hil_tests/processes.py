"""Processes as /proc shows them, also where the kernel lists no children."""

import contextlib
from pathlib import Path


def children_of(pid: int) -> dict[int, list[bytes]]:
    """Return the command lines of a process's children, by their process ids."""
    found = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # others come and go
            if f"PPid:\t{pid}\n" in (entry / "status").read_text():
                found[int(entry.name)] = (entry / "cmdline").read_bytes().split(b"\0")
    return found
