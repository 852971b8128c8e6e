"""Progress of compilation: the first start of the estimators takes up to a minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba.core import event
from numba.core.dispatcher import Dispatcher

from robotctl.compiled import COMPILING

_KIND: Final = "numba:compile"
_OURS: Final = ("robotctl.", "firmware_sim.")
"""Numba also compiles functions of its own, which cannot be counted beforehand."""
_EVERY_S: Final = 2.0
_ANNOUNCING: Final[list[_Listener]] = []
"""Listener of the command that runs; none before the first."""


def _all() -> int:
    """Return how many functions there are to compile in the modules that are loaded."""
    modules = [module for name, module in [*sys.modules.items()] if name.startswith(_OURS)]
    values = (value for module in modules for value in [*vars(module).values()])
    return len({id(value) for value in values if isinstance(value, Dispatcher)})


class _Listener(event.Listener):
    """Counts and reports the functions that numba has compiled."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._done: set[str] = set()
        self._began_s = self._said_s = 0.0

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - as numba calls it
        """Say before the first that it will take a while, and why."""
        if not self._began_s:
            self._began_s = self._said_s = time.monotonic()
            self._say(COMPILING)

    def on_end(self, event: Any) -> None:
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
        event.unregister(_KIND, _ANNOUNCING.pop())  # type: ignore[no-untyped-call]
    _ANNOUNCING.append(_Listener(say))
    event.register(_KIND, _ANNOUNCING[0])  # type: ignore[no-untyped-call]


@contextmanager
def compile_progress(say: Callable[[str], None]) -> Iterator[None]:
    """Report compilation progress for a while; nothing if everything is cached."""
    listener = _Listener(say)
    event.register(_KIND, listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister(_KIND, listener)  # type: ignore[no-untyped-call]
