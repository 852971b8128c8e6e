"""Compilation of inner loops with numba, cached on disk in the folder of `kernel_cache`."""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import numba
from numba.core import caching

from robotctl.kernel_cache import FOLDER, is_beside_sources

P = ParamSpec("P")
R = TypeVar("R")

_FUNCTION_CACHE: Any = caching.FunctionCache
_RESULTS: Any = caching.CompileResultCacheImpl
_LOCATOR: Any = caching._CacheLocator
_SOURCE_FILE: Any = caching._SourceFileBackedLocatorMixin


def _compiling() -> str:
    """Return what `COMPILING` says."""
    if not FOLDER:
        return (
            "compiling, up to minutes at each start: no folder takes the compiled code; "
            "NUMBA_CACHE_DIR=FOLDER names one that does"
        )
    kept = "" if is_beside_sources() else f", to be kept in {FOLDER}"
    return f"compiling, once: up to minutes{kept}; `robotctl compile` does it for all commands"


COMPILING: Final = _compiling()
"""Message for people when that begins."""


class _Locator(_SOURCE_FILE, _LOCATOR):  # type: ignore[misc] # numba has no types
    """Place of the code of a function, by its module."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._lineno = file, function.__code__.co_firstlineno
        self._folder = str(Path(FOLDER, function.__module__))

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Locator:
        """Return where it is kept; the folder is made when there is something to keep."""
        return cls(function, file)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return self._folder


class _Files(_RESULTS):  # type: ignore[misc]
    """The files of a function's code."""

    _locator_classes = (_Locator,)


class _Cache(_FUNCTION_CACHE):  # type: ignore[misc]
    """Compiled code of one function; a file that is cut or a full disk only costs time."""

    _impl_class = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature; None if there is none, or none whole."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - whatever pickle makes of a file that lost its end
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function, if the disk takes it."""
        with suppress(OSError), _alone(Path(FOLDER)):
            super().save_overload(sig, data)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let no other process write an index at the same time: the last one would win."""
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code at its first call; division by zero gives inf or nan."""
    dispatcher: Any = numba.njit(error_model="numpy")(function)
    if FOLDER:
        dispatcher._cache = _Cache(function)  # as its `enable_caching` does
    result: Callable[P, R] = dispatcher
    return result
