"""Compilation of the estimators' inner loops with numba, cached on disk.

Numba renews a cached function when its own file changes, not when a function that it calls in
another file does. So the cache has a folder of its own for each state of the sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")

_NUMBA: Any = numba.config
_PACKAGE = Path(__file__).parent
_KEPT = 4
"""Folders of earlier sources that stay: another checkout or process may still use them."""


def _cache_folder() -> str:
    """Return the folder for compiled code of exactly these sources; "" for numba's choice."""
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"@compiled" in text:
            digest.update(text)
    parent = _PACKAGE / "__pycache__"
    folder = parent / f"compiled-{digest.hexdigest()[:12]}"
    try:
        if not folder.is_dir():
            by_age = sorted(parent.glob("compiled-*"), key=lambda path: path.stat().st_mtime)
            for old in by_age[:-_KEPT]:
                shutil.rmtree(old, ignore_errors=True)
            folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return ""
    return str(folder) if os.access(folder, os.W_OK) else ""


_FOLDER = _cache_folder()


COMPILING = "compiling the estimators, once: up to a minute"
"""What to tell people before that, where the cache is cold."""


def cache_is_cold() -> bool:
    """Return whether nothing is compiled yet, which takes up to a minute the first time."""
    return not _FOLDER or not any(Path(_FOLDER).rglob("*.nbi"))


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code at its first call; division by zero gives inf or nan."""
    before = _NUMBA.CACHE_DIR
    _NUMBA.CACHE_DIR = before or _FOLDER
    try:
        result: Callable[P, R] = numba.njit(cache=True, error_model="numpy")(function)
    finally:
        _NUMBA.CACHE_DIR = before
    return result
