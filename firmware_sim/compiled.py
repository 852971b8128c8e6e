"""Compilation of the inner loops with numba, cached on disk where one takes it.

Numba renews a cached function when its own file changes, not when a function that it calls in
another file does. So the cache has a folder of its own for each state of the sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core import caching

P = ParamSpec("P")
R = TypeVar("R")

_NUMBA: Any = numba.config
_FUNCTION_CACHE: Any = caching.FunctionCache
_RESULTS: Any = caching.CompileResultCacheImpl
_LOCATOR: Any = caching._CacheLocator
_SOURCE_FILE: Any = caching._SourceFileBackedLocatorMixin
_PACKAGE = Path(__file__).parent


def _parents() -> Iterator[Path]:
    """Possible cache folders: the user's choice, beside the sources, in the user's own folders.

    A folder that others can write to is not used, because cached code runs as this user.
    """
    if _NUMBA.CACHE_DIR:
        yield Path(_NUMBA.CACHE_DIR) / "firmware_sim"
    yield _PACKAGE / "__pycache__"
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if cache.is_absolute() and _is_made_private(cache / "robotctl"):  # it is not without a home
        yield cache / "robotctl" / "firmware_sim"
    temporary = Path(tempfile.gettempdir()) / f"robotctl-cache-{os.geteuid()}"
    if _is_made_private(temporary):
        yield temporary / "firmware_sim"


def _is_made_private(folder: Path) -> bool:
    """Make a folder if it is missing; whether it is this user's, and only theirs to write."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return False
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022 and not folder.is_symlink()


def _cache_folder() -> str:
    """Folder of this package for compiled code of exactly these sources; "" where none takes it."""
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"@compiled" in text or b"Final = " in text:
            digest.update(text)
    with suppress(FileNotFoundError):  # no temporary folder at all
        for parent in _parents():
            folder = parent / f"compiled-{digest.hexdigest()[:12]}"
            if _takes_files(folder) or any(folder.glob(_mark("*"))):
                return str(folder)
    return ""


def _takes_files(folder: Path) -> bool:
    """Make a folder of the cache, in place of old ones; whether files can be written there."""
    try:
        if not folder.is_dir():
            _remove_old(folder.parent)
            folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _remove_old(parent: Path) -> None:
    """Remove folders older than a day, which no running process can still be writing."""
    for old in parent.glob("compiled-*"):
        if time.time() - old.stat().st_mtime > 86_400.0:
            shutil.rmtree(old, ignore_errors=True)


def _mark(processor: str) -> str:
    """Name of the empty file that stands for all functions, compiled for a processor."""
    return f"complete-{numba.__version__}-{sys.implementation.cache_tag}-{processor}"


FOLDER = _cache_folder()
"""Folder of the compiled code, "" if it cannot be kept. Only readable where it is complete."""


def is_complete(processor: str) -> bool:
    """Whether all functions were compiled for a processor and are kept."""
    return bool(FOLDER) and Path(FOLDER, _mark(processor)).exists()


def mark_complete(processor: str) -> None:
    """Note that all functions are compiled for a processor; raises OSError if that fails."""
    if FOLDER:
        Path(FOLDER, _mark(processor)).touch()


NOT_KEPT = (
    ""
    if FOLDER
    else "note: no folder takes the compiled code, so each start compiles for half a minute; "
    "NUMBA_CACHE_DIR=FOLDER names one that does"
)
"""Message for the user if compiled code is not kept for the next start, otherwise empty."""


class _Locator(_SOURCE_FILE, _LOCATOR):  # type: ignore[misc] # numba has no types
    """Place of a function's code: a folder named after its module."""

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
    """Files of a function's code."""

    _locator_classes = (_Locator,)


class _Cache(_FUNCTION_CACHE):  # type: ignore[misc]
    """Compiled code of one function; a truncated file or a full disk only costs time."""

    _impl_class = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled function of a signature; None if there is none, or none whole."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - whatever pickle makes of a file that lost its end
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function, if the disk takes it."""
        with suppress(OSError):
            super().save_overload(sig, data)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code at its first call, IEEE arithmetic, no checks of zero.

    The function makes no arrays. So numba need not count references to those that it is given,
    which took a third of a step of the plant, nor hand each over to every function that it calls.
    """
    jit: Any = numba.njit
    return _kept(jit(error_model="numpy", forceinline=True, _nrt=False)(function), function)


def compiled_with_arrays(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that makes arrays of its own; otherwise as `compiled`."""
    return _kept(numba.njit(error_model="numpy")(function), function)


def _kept(dispatcher: Any, function: Callable[P, R]) -> Callable[P, R]:
    """Let the code of a compiled function be kept on disk."""
    if FOLDER:
        dispatcher._cache = _Cache(function)  # as its `enable_caching` does
    result: Callable[P, R] = dispatcher
    return result


def noise_state(rng: np.random.Generator) -> np.ndarray:
    """State of a fresh stream of `uniform` and `normal`, seeded from a generator."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@compiled
def uniform(state: np.ndarray) -> float:
    """Next number in [0, 1) of the stream (SplitMix64: Steele, Lea and Flood, OOPSLA 2014)."""
    z = state[0] + np.uint64(0x9E3779B97F4A7C15)
    state[0] = z
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(np.float64(z >> np.uint64(11)) * 1.1102230246251565e-16)


@compiled
def normal(state: np.ndarray) -> float:
    """Next standard normal number of the stream (Box and Muller)."""
    radius = np.sqrt(-2.0 * np.log(1.0 - uniform(state)))
    return float(radius * np.cos(2.0 * np.pi * uniform(state)))
