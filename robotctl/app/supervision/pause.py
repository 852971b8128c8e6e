"""A stalled process: duration, cause and message."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

_STATES: Final = {
    "T": "stopped by a signal",
    "t": "stopped by a debugger",
    "D": "waits for a disk or device",
    "R": "computes, or gets no processor",
    "S": "waits for something",
    "Z": "has ended",
}
"""State of a process by its letter in proc_pid_stat(5)."""


@dataclass(frozen=True, slots=True)
class Pause:
    """A process made no progress, or has continued.

    Parameters
    ----------
    name, pid
        Process concerned.
    paused_s
        Duration [s].
    cause
        State of the process meanwhile, according to the kernel; empty if unknown.
    over
        Whether it has continued.
    """

    name: str
    pid: int
    paused_s: float
    cause: str
    over: bool

    def words(self) -> str:
        """Return a line for people."""
        cause = f" ({self.cause})" if self.cause else ""
        if self.over:
            return f"{self.name} was held up for {self.paused_s:.1f} s{cause}; it goes on"
        return f"{self.name} is held up: no progress for {self.paused_s:.1f} s{cause}"


def state_of(pid: int) -> str:
    """Return the state of a process as text; empty if the kernel does not report it."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    letter = stat.rpartition(")")[2].split()[:1]  # its name before may hold anything
    return _STATES.get(letter[0], "") if letter else ""


def killed_for_memory() -> int:
    """Return the number of processes that the kernel has killed for lack of memory."""
    try:
        lines = Path("/proc/vmstat").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("oom_kill ")), 0)
