"""Inner loops in machine code: out of a library where there is one, else compiled by numba.

With the library a process loads neither numba nor llvmlite, unless a kernel is called with types
that it was not compiled for.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar

from native_kernels.library import native_kernel

P = ParamSpec("P")
R = TypeVar("R")

_WAITING: Final[list[Callable[[], None]]] = []


def borrows(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function, below `@compiled`, that makes no arrays and only uses those of its caller.

    References to them, which cost an inner loop more than its own work, are not counted in it, and
    compiled callers take it in. Numba refuses one that makes an array.
    """
    function.borrows = True  # type: ignore[attr-defined]
    return function


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function as machine code; division by zero gives inf or nan."""
    kernel: Callable[P, R] = native_kernel(function, _dispatcher_of) or _dispatcher_of(function)
    return kernel


def _dispatcher_of(function: Any) -> Any:
    """Return what compiles a function at its first call."""
    from native_kernels.by_numba import dispatcher_of  # noqa: PLC0415 - 0.4 s and 45 MB

    while _WAITING:
        _WAITING.pop(0)()
    return dispatcher_of(function)


def with_numba(call: Callable[[], None]) -> None:
    """Call something as soon as numba is loaded, which may never be."""
    if "numba" in sys.modules:
        call()
    else:
        _WAITING.append(call)


def without_numba(call: Callable[[], None]) -> bool:
    """Take back what waits for numba; return whether it still did."""
    if waits := call in _WAITING:
        _WAITING.remove(call)
    return waits
