"""Compilation of all kernels ahead of time, on all processors: the work of `robotctl compile`.

Each module of this package but two has a `warm_up` that calls kernels with whatever fits them,
where possible as a starting robot warms up itself, over all entries of a registry.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from queue import Queue
from typing import Any, Final, TypeAlias

from robotctl import kernel_cache
from robotctl.app.supervision.child_process import lines_of, start_child
from robotctl.errors import RobotctlError
from robotctl.native_kernels import library_path

_HERE: Final = "robotctl.workbench.compile"
_ROBOT: Final = ("mapping", "navigation", "paths", "recordings")
_SIMULATION: Final = "simulation"
"""Modules of this package whose `warm_up` calls kernels: a process each, as they share few."""
_POLL_S: Final = 0.25

Tell: TypeAlias = Callable[[int, int], None]
"""Is told how many functions are compiled, and of how many."""


class CompileError(RobotctlError):
    """Kernels cannot be compiled, or not be kept."""


@dataclass(frozen=True, slots=True)
class Kernels:
    """The kernels of a robot, or with `simulated` also those of firmware_sim."""

    simulated: bool = True

    def _caches(self) -> list[Any]:
        """Modules with the folder of a package's kernels, and whether all are in it."""
        # By name: a robot does without firmware_sim, and its processes without numba.
        return [kernel_cache, *([import_module("firmware_sim.compiled")] if self.simulated else [])]

    @property
    def total(self) -> int:
        """How many there are."""
        return sum(kernel_cache.kernels_of(Path(each.__file__).parent) for each in self._caches())

    @property
    def done(self) -> int:
        """How many are in the cache."""
        files = (Path(each.FOLDER).rglob("*.nbi") for each in self._caches() if each.FOLDER)
        return sum(1 for each in files for _ in each)

    @property
    def missing(self) -> str:
        """Why they have to be compiled; empty if they need not be, or cannot be kept."""
        if not kernel_cache.FOLDER:
            return ""
        # The library is for this processor; to ask what that is loads llvmlite.
        caches = self._caches()[1:] if library_path().exists() else self._caches()
        if not caches:
            return ""
        here = kernel_cache.processor()
        if all(each.is_complete(here) for each in caches):
            return ""
        if kernel_cache.is_complete():
            return f"they were compiled for another processor than this one, {here}"
        return "nothing of these sources is compiled yet"

    @property
    def lack_library(self) -> bool:
        """Whether there is no library of them, but what makes one."""
        return not library_path().exists() and all(compilers())

    def compile(self, tell: Tell = lambda *_: None) -> str:
        """Compile what is missing, on all processors; return why there is no library of it.

        Without the library, which needs a compiler for C, each process loads numba. "": there is.

        Raises
        ------
        CompileError
            If no folder takes what is compiled, or a process fails; says why.
        """
        for each in self._caches():
            _check_folder(each.FOLDER)
        total = self.total
        library_path().unlink(missing_ok=True)  # so that numba compiles

        def watch() -> None:
            tell(min(self.done, total), total)

        _run([*_ROBOT, *([_SIMULATION] if self.simulated else [])], watch)
        try:
            _run(["native_library"], watch, "build")
            without = ""
        except CompileError as error:
            without = str(error)
        try:
            for each in self._caches():
                each.mark_complete(kernel_cache.processor())
        except OSError as error:
            raise CompileError(f"{error.filename}: {error.strerror}") from error
        return without


def compilers() -> tuple[str | None, str | None]:
    """Return the compilers for C and C++, as CC and CXX name them; None: there is none."""
    c, cpp = os.environ.get("CC", "cc"), os.environ.get("CXX", "c++")
    return shutil.which(c), shutil.which(cpp)


def _check_folder(folder: str) -> None:
    """Raise CompileError if a cache's folder takes no files."""
    how = "NUMBA_CACHE_DIR=FOLDER names another one"
    if not folder:
        raise CompileError(
            "compiled code cannot be kept: neither the package's folder, nor one in the user's "
            f"home or the temporary folder can be written to; {how}"
        )
    if not os.access(folder, os.W_OK):
        raise CompileError(
            f"{folder}: cannot be written to, and is of another processor than this one, "
            f"{kernel_cache.processor()}; run `robotctl compile` as its owner, or {how}"
        )


def _run(units: list[str], watch: Callable[[], None], function: str = "warm_up") -> None:
    """Run each module's function, as many at a time as there are processors."""
    at_once = len(os.sched_getaffinity(0))
    running: dict[str, tuple[subprocess.Popen[str], Queue[str | None]]] = {}
    try:
        while units or running:
            while units and len(running) < at_once:
                name = units.pop(0)
                code = f"from {_HERE}.{name} import {function}; {function}()"
                command = [sys.executable, "-c", code]
                process = start_child(
                    command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
                )
                running[name] = process, lines_of(process)
            for name, (process, lines) in [*running.items()]:
                if process.poll() is not None:
                    del running[name]
                    last = _last_line(process, lines)
                    if process.returncode:
                        raise CompileError(f"{name}: its functions cannot be compiled: {last}")
            watch()
            time.sleep(_POLL_S)
    finally:
        for process, lines in running.values():
            process.kill()
            _last_line(process, lines)


def _last_line(process: subprocess.Popen[str], lines: Queue[str | None]) -> str:
    """Wait for the end of a process; return the last line that it printed."""
    last = ""
    while (line := lines.get()) is not None:
        last = line.strip() or last
    with process:  # closes the pipe
        return last or f"status {process.wait()}"
