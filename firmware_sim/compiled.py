"""Compilation of the inner loops with numba, cached on disk.

Numba renews a cached function when its own file changes, not when a function that it calls in
another file does. So the cache has a folder of its own for each state of the sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

_NUMBA: Any = numba.config
_PACKAGE = Path(__file__).parent


def _cache_folder() -> str:
    """Folder of this package for compiled code of exactly these sources; "" for numba's choice."""
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.glob("*.py")):
        text = source.read_bytes()
        if b"@compiled" in text or b"Final = " in text:
            digest.update(text)
    parent = _PACKAGE / "__pycache__"
    folder = parent / f"compiled-{digest.hexdigest()[:12]}"
    try:
        if not folder.is_dir():
            _remove_old(parent)
            folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return ""
    return str(folder) if os.access(folder, os.W_OK) else ""


def _remove_old(parent: Path) -> None:
    """Remove what no running process can still be writing: folders older than a day."""
    for old in parent.glob("compiled-*"):
        if time.time() - old.stat().st_mtime > 86_400.0:
            shutil.rmtree(old, ignore_errors=True)


_FOLDER = _cache_folder()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code at its first call, IEEE arithmetic, no checks of zero."""
    before = _NUMBA.CACHE_DIR
    _NUMBA.CACHE_DIR = before or _FOLDER
    try:
        result: Callable[P, R] = numba.njit(cache=True, error_model="numpy")(function)
    finally:
        _NUMBA.CACHE_DIR = before
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
