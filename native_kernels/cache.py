"""Folder of a package's compiled functions (kernels), and whether all of them are in it.

Numba renews a cached function when its own file changes, not when a function that it calls in
another file does. So each has a digest of all that it is made of (`digests`), and the cache
a folder of its own for each set of kernels, wherever their sources are: copies may share it. A new
folder takes over what is in the earlier ones and still holds. What reads this loads neither numba
nor llvmlite.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

_LIBRARY: Final = tuple(Path(__file__).with_name(name) for name in ("library.c", "build.py"))
"""Sources of what makes a library of the kernels (`library`)."""
_MAKERS: Final = tuple(Path(__file__).with_name(name) for name in ("by_numba.py", "digests.py"))
"""What compiles a kernel, which its digest covers, too, and what makes that."""
_KERNEL: Final = re.compile(rb"^ *@compiled$", re.MULTILINE)
_KEPT: Final = 4
"""Folders of earlier kernels that stay: another checkout or process may still use them."""
_KEPT_DIGESTS: Final = 16
"""Files with digests that stay, two of each state of all sources."""
_GRAIN_NS: Final = 2_000_000_000
"""Grain of the times of files on the coarsest file systems."""


@dataclass(slots=True, eq=False)
class KernelCache:
    """Place of a package's compiled code."""

    package: Path
    """Folder of the sources."""
    digests: dict[str, str]
    """Digests of the kernels, by module, colon and name; of one within a function by that."""
    digest: str
    """Digest of all kernels, and of what makes a library of them."""
    folder: str
    """Folder of the compiled code, "" if it cannot be kept. Only readable where it is complete."""

    def is_complete(self, processor: str = "*") -> bool:
        """Return whether all kernels were compiled for a processor (`*`: for any), and are kept."""
        return bool(self.folder) and any(Path(self.folder).glob(_mark(processor)))

    def mark_complete(self, processor: str) -> None:
        """Note that all kernels are compiled for a processor.

        Raises
        ------
        OSError
            If the folder takes no file.
        """
        (Path(self.folder) / _mark(processor)).touch()

    @property
    def is_beside_sources(self) -> bool:
        """Whether the folder lies in the package, its place unless told otherwise."""
        return self.package in Path(self.folder).parents

    @property
    def total(self) -> int:
        """Number of functions of the package that are to be compiled."""
        sources = self.package.rglob("*.py")
        return sum(len(_KERNEL.findall(path.read_bytes())) for path in sources)

    @property
    def done(self) -> int:
        """Number of them in the folder."""
        return sum(1 for _ in Path(self.folder).rglob("*.nbi")) if self.folder else 0


@cache
def cache_of(package: str) -> KernelCache:
    """Return the cache of a package; what is no package with a folder of sources keeps nothing."""
    init = Path(getattr(import_module(package), "__file__", None) or "")
    if init.name != "__init__.py":
        return KernelCache(init, {}, "", "")
    digests = _digests(init.parent)
    digest = _digest(digests)
    return KernelCache(init.parent, digests, digest, _cache_folder(init.parent, digest, digests))


def package_of(function: Any) -> str:
    """Return the name of the package that a function is in."""
    name: str = function.__module__
    return name.partition(".")[0]


def _parents(package: Path) -> Iterator[Path]:
    """Possible places of the cache: the user's choice, with the sources, in the user's own folders.

    A folder that others can write to is not used, because cached code runs as this user.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen) / package.name
    yield package / "__pycache__"
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if cache.is_absolute() and _is_made_private(cache / "robotctl"):  # it is not without a home
        yield cache / "robotctl" / package.name
    temporary = Path(tempfile.gettempdir()) / f"robotctl-cache-{os.geteuid()}"
    if _is_made_private(temporary):
        yield temporary / package.name


def _is_made_private(folder: Path) -> bool:
    """Make a folder if it is missing; return whether only this user can write to it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return False
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022 and not folder.is_symlink()


def _digests(package: Path) -> dict[str, str]:
    """Return the digests of all kernels, from a file where these very sources were seen before.

    They are known again without being read by what the file system tells of them, with the time of
    the last change of anything, which no program sets. Just written ones are not: within the grain
    of that time they may change once more.
    """
    now_ns = time.time_ns()
    files = [(str(path), path.stat()) for path in _MAKERS] + sorted(_files(str(package)))
    told = [(each.st_size, each.st_ino, each.st_mtime_ns, each.st_ctime_ns) for _, each in files]
    state = _name(repr([*zip((path for path, _ in files), told, strict=True)]).encode())
    if found := _found(package, state):
        return found
    texts = {Path(path): Path(path).read_bytes() for path, _ in files}
    digests = _digests_of(package, texts)
    if max(each.st_ctime_ns for _, each in files) < now_ns - _GRAIN_NS:
        _keep(package, state, digests)
    return digests


def _files(folder: str) -> Iterator[tuple[str, os.stat_result]]:
    """Yield the sources in a folder, and what is told of each."""
    with os.scandir(folder) as entries:
        for each in entries:
            if each.name.endswith(".py"):
                yield each.path, each.stat()
            elif each.name != "__pycache__" and each.is_dir(follow_symlinks=False):
                yield from _files(each.path)


def _digests_of(package: Path, texts: dict[Path, bytes]) -> dict[str, str]:
    """Return the digests of all kernels in these sources, from a file if any copy had them."""
    whole = hashlib.sha256()
    for path, text in texts.items():
        place = path.name if path in _MAKERS else path.relative_to(package)
        whole.update(f"{place} {len(text)} ".encode())
        whole.update(text)
    content = _name(whole.digest())
    if found := _found(package, content):
        return found
    from native_kernels.digests import KernelDigests  # noqa: PLC0415 - after a change only

    compiler, _ = (texts.pop(path) for path in _MAKERS)
    digests = KernelDigests(package, texts, compiler).all()
    _keep(package, content, digests)
    return digests


def _name(told: bytes) -> str:
    """Return the name of the file with digests of sources of which this is told."""
    return f"kernels-{hashlib.sha256(told).hexdigest()[:16]}.json"


def _found(package: Path, name: str) -> dict[str, str] | None:
    """Return the digests in a file of this name, None if there is none."""
    with suppress(FileNotFoundError):  # no temporary folder at all
        for parent in _parents(package):
            with suppress(OSError, ValueError):
                found: dict[str, str] = json.loads((parent / name).read_bytes())
                return found
    return None


def _keep(package: Path, name: str, digests: dict[str, str]) -> None:
    """Keep digests in the first place that takes them, instead of old ones."""
    with suppress(FileNotFoundError):
        for parent in _parents(package):
            with suppress(OSError):
                parent.mkdir(parents=True, exist_ok=True)
                own = (parent / name).with_suffix(f".{os.getpid()}")
                own.write_text(json.dumps(digests), encoding="utf-8")
                own.replace(parent / name)
                for old in _by_age(parent, "kernels-*")[:-_KEPT_DIGESTS]:
                    old.unlink(missing_ok=True)
                return


def _by_age(parent: Path, pattern: str) -> list[Path]:
    """Return files and folders of the cache, the oldest first."""
    return sorted(parent.glob(pattern), key=lambda path: path.stat().st_mtime)


def _digest(digests: dict[str, str]) -> str:
    """Return one digest of kernels with these, and of what makes a library of them."""
    made = hashlib.sha256(json.dumps(digests, sort_keys=True).encode())
    for source in _LIBRARY:
        made.update(source.read_bytes())
    return made.hexdigest()[:12]


def _cache_folder(package: Path, digest: str, digests: dict[str, str]) -> str:
    """Return the folder for compiled code of exactly these kernels; "" where none takes it."""
    with suppress(FileNotFoundError):  # no temporary folder at all
        for parent in _parents(package):
            folder = parent / f"compiled-{digest}"
            if _takes_files(folder, digests) or any(folder.glob(_mark("*"))):
                return str(folder)
    return ""


def _takes_files(folder: Path, digests: dict[str, str]) -> bool:
    """Make a folder of the cache, in place of old ones; return whether it takes files."""
    try:
        if not folder.is_dir():
            earlier = _by_age(folder.parent, "compiled-*")
            for old in earlier[:-_KEPT]:
                shutil.rmtree(old, ignore_errors=True)
            own = folder.with_suffix(f".{os.getpid()}")
            own.mkdir(parents=True)
            _take_over(own, earlier[-_KEPT:], set(digests.values()))
            try:
                own.rename(folder)
            except OSError:  # another process was faster
                shutil.rmtree(own)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _take_over(folder: Path, earlier: list[Path], digests: set[str]) -> None:
    """Put compiled code with these digests into a folder, each from the last that has it."""
    for old in reversed(earlier):
        taken: set[str] = set()
        with suppress(OSError), alone(old):
            for file in sorted(old.rglob("*-*.nb[ci]")):  # code before the index that tells of it
                digest = file.name.rpartition("-")[2].partition(".")[0]
                if digest in digests:
                    to = folder / file.parent.name / file.name
                    to.parent.mkdir(exist_ok=True)
                    to.hardlink_to(file)
                    taken.add(digest)
        digests = digests - taken


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Let no other process write an index at the same time: the last one would win."""
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


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
