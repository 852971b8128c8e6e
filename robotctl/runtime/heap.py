"""Memory that arrays leave behind is given back to the system."""

from __future__ import annotations

import ctypes
from typing import Final

_M_MMAP_THRESHOLD: Final = -3
_LARGE: Final = 2**20
"""Bytes from which on an array has pages of its own."""


def map_large_arrays() -> None:
    """Give large arrays pages of their own, from now on and in the whole process.

    By default the C library of Linux takes them from the heap as soon as some have been freed
    (mallopt(3), the dynamic threshold), where small objects behind them keep what they leave.
    Other systems have no such setting.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGE)
