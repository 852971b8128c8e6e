"""End of this process together with its parent."""

from __future__ import annotations

import ctypes
import os
import signal
from types import FrameType
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
"""Option of prctl(2)."""


def end_with_parent() -> None:
    """Raise SIGTERM in this process when its parent ends, even by SIGKILL.

    A simulator left running would keep its bus and its shared memory, and so disturb the next run.
    """
    parent = os.getppid()

    def look(_number: int, _frame: FrameType | None) -> None:
        # The kernel also sends the signal when only the thread that started us has ended.
        if os.getppid() != parent:
            os.kill(os.getpid(), signal.SIGTERM)

    signal.signal(signal.SIGUSR2, look)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGUSR2, 0, 0, 0)
    look(signal.SIGUSR2, None)  # it may have ended before prctl: then no signal will come
