"""Progress of compilation: the first start of the estimators takes up to a minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from native_kernels.cache import cache_of
from native_kernels.compiled import with_numba, without_numba
from native_kernels.library import LOADED

_KIND: Final = "numba:compile"
_OURS: Final = ("robotctl.", "firmware_sim.")
"""Numba also compiles functions of its own, which cannot be counted beforehand."""
_EVERY_S: Final = 2.0
_ANNOUNCING: Final[list[_Listener]] = []
"""Listener of the command that runs; none before the first."""


def _all() -> int:
    """Return how many functions there are to compile in the modules that are loaded."""
    from numba.core.dispatcher import Dispatcher  # noqa: PLC0415 - loaded when this is asked

    kinds = (Dispatcher, *(each.Kernel for each in LOADED))
    modules = [module for name, module in [*sys.modules.items()] if name.startswith(_OURS)]
    values = (value for module in modules for value in [*vars(module).values()])
    return len({id(value) for value in values if isinstance(value, kinds)})


def compiling() -> str:
    """Return the message for people when compilation begins."""
    cache = cache_of("robotctl")
    if not cache.folder:
        return (
            "compiling, up to minutes at each start: no folder takes the compiled code; "
            "NUMBA_CACHE_DIR=FOLDER names one that does"
        )
    kept = "" if cache.is_beside_sources else f", to be kept in {cache.folder}"
    return f"compiling, once: up to minutes{kept}; `robotctl compile` does it for all commands"


class _Listener:
    """Counts and reports the functions that numba has compiled."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._done: set[str] = set()
        self._began_s = self._said_s = 0.0

    def start(self) -> None:
        """Listen, from when numba is loaded on."""
        with_numba(self._register)

    def stop(self) -> None:
        """Listen no more."""
        if not without_numba(self._register):
            from numba.core import event  # noqa: PLC0415 - loaded already

            event.unregister(_KIND, self)  # type: ignore[no-untyped-call]

    def _register(self) -> None:
        from numba.core import event  # noqa: PLC0415 - loaded when this is called

        event.Listener.register(_Listener)
        event.register(_KIND, self)  # type: ignore[no-untyped-call]

    def notify(self, event: Any) -> None:
        """Take an event of numba."""
        if event.is_start:
            self._begin()
        else:
            self._end(event)

    def _begin(self) -> None:
        """Say before the first that it will take a while, and why."""
        if not self._began_s:
            self._began_s = self._said_s = time.monotonic()
            self._say(compiling())

    def _end(self, event: Any) -> None:
        """Report progress from time to time."""
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith(_OURS):
            self._done.add(f"{function.__module__}.{function.__qualname__}")
        now_s = time.monotonic()
        if now_s - self._said_s >= _EVERY_S:
            self._said_s = now_s
            self._say(
                f"compiling: {len(self._done)} of at most {_all()} functions, "
                f"{now_s - self._began_s:.0f} s"
            )


def announce_compiling(say: Callable[[str], None]) -> None:
    """Report compilation progress until the next call; nothing if everything is cached."""
    while _ANNOUNCING:
        _ANNOUNCING.pop().stop()
    _ANNOUNCING.append(_Listener(say))
    _ANNOUNCING[0].start()


@contextmanager
def compile_progress(say: Callable[[str], None]) -> Iterator[None]:
    """Report compilation progress for a while; nothing if everything is cached."""
    listener = _Listener(say)
    listener.start()
    try:
        yield
    finally:
        listener.stop()
