"""Folder of the compiled functions (kernels), and whether all of them are in it.

Numba renews a cached function when its own file changes, not when a function that it calls in
another file does. So the cache has a folder of its own for each state of the sources, wherever they
are: copies of the same sources may share it. What reads this loads neither numba nor llvmlite.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Final

_PACKAGE: Final = Path(__file__).parent
_IMPORT: Final = re.compile(rb"^from robotctl\.([\w.]+) import ([^(\n]+|\([^)]*\))", re.MULTILINE)
_CONSTANT: Final = re.compile(rb"\b[A-Z][A-Z0-9_]+\b")
_KERNEL: Final = re.compile(rb"^ *@compiled$", re.MULTILINE)
_KEPT: Final = 4
"""Folders of earlier sources that stay: another checkout or process may still use them."""


def _parents() -> Iterator[Path]:
    """Possible places of the cache: the user's choice, with the sources, in the user's own folders.

    A folder that others can write to is not used, because cached code runs as this user.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen) / "robotctl"
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
    """Return the sources of compiled code: of functions, and of constants that they import."""
    found = {
        path: text
        for path in sorted(_PACKAGE.rglob("*.py"))
        if _KERNEL.search(text := path.read_bytes())
    }
    new = list(found.values())
    while new:
        for module, names in _IMPORT.findall(new.pop()):
            path = _PACKAGE.joinpath(*module.decode().split(".")).with_suffix(".py")
            if _CONSTANT.search(names) and path not in found:
                found[path] = path.read_bytes()
                new.append(found[path])
    how = _PACKAGE / "compiled.py"
    return {**found, how: how.read_bytes()}


def _cache_folder() -> str:
    """Return the folder for compiled code of exactly these sources; "" where none takes it."""
    digest = hashlib.sha256()
    for text in _sources().values():
        digest.update(text)
    with suppress(FileNotFoundError):  # no temporary folder at all
        for parent in _parents():
            folder = parent / f"compiled-{digest.hexdigest()[:12]}"
            if _takes_files(folder) or any(folder.glob(_mark("*"))):
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


def processor() -> str:
    """Return the processor that numba compiles for, with a digest of its features."""
    from llvmlite import binding  # noqa: PLC0415 - 90 MB

    name = os.environ.get("NUMBA_CPU_NAME") or binding.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES") or (
        "" if name == "generic" else binding.get_host_cpu_features().flatten()
    )
    return f"{name}-{hashlib.sha256(features.encode()).hexdigest()[:8]}"


def _mark(processor: str) -> str:
    """Name of the empty file that stands for all kernels, compiled for a processor."""
    return f"complete-{version('numba')}-{sys.implementation.cache_tag}-{processor}"


FOLDER: Final = _cache_folder()
"""Folder of the compiled code, "" if it cannot be kept. Only readable where it is complete."""


def is_complete(processor: str = "*") -> bool:
    """Return whether all kernels were compiled for a processor (`*`: for any), and are kept."""
    return bool(FOLDER) and any(Path(FOLDER).glob(_mark(processor)))


def mark_complete(processor: str) -> None:
    """Note that all kernels are compiled for a processor.

    Raises
    ------
    OSError
        If the folder takes no file.
    """
    (Path(FOLDER) / _mark(processor)).touch()


def is_beside_sources() -> bool:
    """Return whether the folder lies in the package, its place unless told otherwise."""
    return _PACKAGE in Path(FOLDER).parents


def kernels_of(package: Path) -> int:
    """Return how many functions of a package are to be compiled."""
    return sum(len(_KERNEL.findall(path.read_bytes())) for path in package.rglob("*.py"))
