"""Compilation of inner loops with numba, cached on disk where one takes it.

Numba renews a cached function when its own file changes, not when a function that it calls in
another file does. So the cache has a folder of its own for each state of the sources, wherever they
are: copies of the same sources may share it.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import caching

P = ParamSpec("P")
R = TypeVar("R")

_NUMBA: Any = numba.config
_FUNCTION_CACHE: Any = caching.FunctionCache
_RESULTS: Any = caching.CompileResultCacheImpl
_LOCATOR: Any = caching._CacheLocator
_SOURCE_FILE: Any = caching._SourceFileBackedLocatorMixin
_PACKAGE = Path(__file__).parent
_IMPORT = re.compile(rb"^from robotctl\.([\w.]+) import ([^(\n]+|\([^)]*\))", re.MULTILINE)
_CONSTANT = re.compile(rb"\b[A-Z][A-Z0-9_]+\b")
_KEPT = 4
"""Folders of earlier sources that stay: another checkout or process may still use them."""


def _parents() -> Iterator[Path]:
    """Yield where the cache may be: as the user says, with the sources, in the user's own folders.

    A folder that somebody else could write to is none: what is cached runs as this user.
    """
    if _NUMBA.CACHE_DIR:
        yield Path(_NUMBA.CACHE_DIR) / "robotctl"
    yield _PACKAGE / "__pycache__"
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if cache.is_absolute() and _is_made_private(cache / "robotctl"):  # it is not without a home
        yield cache / "robotctl" / "robotctl"
    temporary = Path(tempfile.gettempdir()) / f"robotctl-cache-{os.geteuid()}"
    if _is_made_private(temporary):
        yield temporary / "robotctl"


def _is_made_private(folder: Path) -> bool:
    """Make a folder if it is missing; return whether only this user can write to it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return False
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022 and not folder.is_symlink()


def _sources() -> dict[Path, bytes]:
    """Return the sources of compiled code: of the functions, and of constants that they import."""
    found = {
        path: text
        for path in sorted(_PACKAGE.rglob("*.py"))
        if b"@compiled" in (text := path.read_bytes())
    }
    new = list(found.values())
    while new:
        for module, names in _IMPORT.findall(new.pop()):
            path = _PACKAGE.joinpath(*module.decode().split(".")).with_suffix(".py")
            if _CONSTANT.search(names) and path not in found:
                found[path] = path.read_bytes()
                new.append(found[path])
    return found


def _cache_folder() -> str:
    """Return the folder for compiled code of exactly these sources; "" where none takes it."""
    digest = hashlib.sha256()
    for text in _sources().values():
        digest.update(text)
    with suppress(FileNotFoundError):  # no temporary folder at all
        for parent in _parents():
            folder = parent / f"compiled-{digest.hexdigest()[:12]}"
            if _takes_files(folder):
                return str(folder)
    return ""


def _takes_files(folder: Path) -> bool:
    """Make a folder of the cache, in place of old ones; return whether it takes files."""
    try:
        if not folder.is_dir():
            earlier = folder.parent.glob("compiled-*")
            by_age = sorted(earlier, key=lambda path: path.stat().st_mtime)
            for old in by_age[:-_KEPT]:
                shutil.rmtree(old, ignore_errors=True)
            folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


_FOLDER = _cache_folder()


def _compiling() -> str:
    """Return what `COMPILING` says."""
    if not _FOLDER:
        return (
            "compiling the estimators, up to a minute at each start: no folder takes the compiled "
            "code; NUMBA_CACHE_DIR=FOLDER names one that does"
        )
    kept = "" if _PACKAGE in Path(_FOLDER).parents else f", to be kept in {_FOLDER}"
    return f"compiling the estimators, once: up to a minute{kept}"


COMPILING = _compiling()
"""What to tell people before that, where the cache is cold."""


def cache_is_cold() -> bool:
    """Return whether nothing is compiled yet, which takes up to a minute the first time."""
    return not _FOLDER or not any(Path(_FOLDER).rglob("*.nbi"))


class _Locator(_SOURCE_FILE, _LOCATOR):  # type: ignore[misc] # numba has no types
    """Where the code of a function is, by its module."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._lineno = file, function.__code__.co_firstlineno
        self._folder = str(Path(_FOLDER, function.__module__))

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
    """What is compiled of one function; a file that is cut or a full disk only costs time."""

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
        with suppress(OSError):
            super().save_overload(sig, data)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code at its first call; division by zero gives inf or nan."""
    dispatcher: Any = numba.njit(error_model="numpy")(function)
    if _FOLDER:
        dispatcher._cache = _Cache(function)  # as its `enable_caching` does
    result: Callable[P, R] = dispatcher
    return result
