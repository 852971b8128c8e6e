"""Child processes that do not outlive their parent."""

from __future__ import annotations

import ctypes
import functools
import os
import queue
import signal
import subprocess
import threading
from typing import Any

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def end_with(parent: int, by: signal.Signals) -> None:
    """Let the kernel send this process a signal when the thread that started it ends.

    Parameters
    ----------
    parent
        Process that started it, which may have ended before: then the signal comes at once.
    by
        The signal.
    """
    _libc.prctl(_PR_SET_PDEATHSIG, by, 0, 0, 0)
    if os.getppid() != parent:
        os.kill(os.getpid(), by)


def start_child(command: list[str], **options: Any) -> subprocess.Popen[Any]:
    """Start a process in a session of its own, so that Ctrl-C reaches only its parent.

    When the parent ends, however it ends, the kernel sends the child SIGTERM: a robot must not
    drive on because a terminal was closed. SIGUSR1, the emergency stop, which may be sent to all
    processes at once, is blocked from the first instruction on. It kills none of them, and stays
    pending in the control process until that handles it (`EmergencySignal`).

    Parameters
    ----------
    command
        Program and arguments.
    options
        Options of `subprocess.Popen`.
    """
    parent = os.getpid()

    # A child inherits the mask of the thread that forks it; blocked later, a signal could win.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGUSR1,))
    try:
        return subprocess.Popen(  # noqa: S603 - our own modules
            command,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=functools.partial(end_with, parent, signal.SIGTERM),  # noqa: PLW1509 - nothing but a few system calls
            **options,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def lines_of(process: subprocess.Popen[str]) -> queue.Queue[str | None]:
    """Return the lines that a process prints, None at their end; its pipe never fills up."""
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        if process.stdout is not None:
            for line in process.stdout:
                lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    return lines
