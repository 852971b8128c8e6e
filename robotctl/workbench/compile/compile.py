"""Compilation of all kernels ahead of time, on all processors: the work of `robotctl compile`.

Each other module of this package has a `warm_up` that calls kernels with whatever fits them,
where possible as a starting robot warms up itself, over all entries of a registry.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import Queue
from typing import Final, TypeAlias

from native_kernels.cache import KernelCache, cache_of, processor
from native_kernels.library import compilers, found_library
from robotctl.app.supervision.child_process import lines_of, start_child
from robotctl.errors import RobotctlError

_HERE: Final = "robotctl.workbench.compile"
_ROBOT: Final = ("mapping", "navigation", "paths", "recordings")
_SIMULATION: Final = "simulation"
"""Modules of this package whose `warm_up` calls kernels: a process each, as they share few."""
_BUILDER: Final = "native_kernels.build"
_POLL_S: Final = 0.25

Tell: TypeAlias = Callable[[int, int], None]
"""Is told how many functions are compiled, and of how many."""


class CompileError(RobotctlError):
    """Kernels cannot be compiled, or not be kept."""


@dataclass(frozen=True, slots=True)
class Kernels:
    """The kernels of a robot, or with `simulated` also those of firmware_sim."""

    simulated: bool = True

    @property
    def packages(self) -> tuple[str, ...]:
        """Names of their packages."""
        return ("robotctl", "firmware_sim") if self.simulated else ("robotctl",)

    def _caches(self) -> list[KernelCache]:
        return [cache_of(each) for each in self.packages]

    @property
    def total(self) -> int:
        """How many there are."""
        return sum(each.total for each in self._caches())

    @property
    def done(self) -> int:
        """How many are in the cache."""
        return sum(each.done for each in self._caches())

    @property
    def missing(self) -> str:
        """Why they have to be compiled; empty if they need not be, or cannot be kept."""
        # A library is for this processor; to ask what that is loads llvmlite.
        caches = [cache_of(each) for each in self.packages if found_library(each) is None]
        if not caches or not all(each.folder for each in caches):
            return ""
        here = processor()
        if all(each.is_complete(here) for each in caches):
            return ""
        if all(each.is_complete() for each in caches):
            return f"they were compiled for another processor than this one, {here}"
        return "nothing of these sources is compiled yet"

    @property
    def lack_library(self) -> bool:
        """Whether a package has no library of them, but there is what makes one."""
        return all(compilers()) and None in map(found_library, self.packages)

    def compile(self, tell: Tell = lambda *_: None) -> str:
        """Compile what is missing, on all processors; return why there is no library of it.

        Without the library, which needs a compiler for C, each process loads numba. "": there is.

        Raises
        ------
        CompileError
            If no folder takes what is compiled, or a process fails; says why.
        """
        # A library, one that a wheel brought too, stays: numba would compile nothing that is in it.
        lacking = [each for each in self.packages if found_library(each) is None]
        caches = [cache_of(each) for each in lacking]
        for each in caches:
            _check_folder(each.folder)
        total = self.total

        def watch() -> None:
            tell(min(self.done, total), total)

        names = [*_ROBOT, *([_SIMULATION] if self.simulated else [])]
        _run({each: f"from {_HERE}.{each} import warm_up; warm_up()" for each in names}, watch)
        built = f"from {_BUILDER} import build; build({{!r}})"
        try:
            units = {f"library of {each}": built.format(each) for each in lacking}
            _run(units, lambda: tell(total, total))
            without = ""
        except CompileError as error:
            without = str(error)
        try:
            for each in caches:
                each.mark_complete(processor())
        except OSError as error:
            raise CompileError(f"{error.filename}: {error.strerror}") from error
        return without


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
            f"{processor()}; run `robotctl compile` as its owner, or {how}"
        )


def _run(units: dict[str, str], watch: Callable[[], None]) -> None:
    """Run the code of each unit, by its name, as many at a time as there are processors."""
    at_once = len(os.sched_getaffinity(0))
    running: dict[str, tuple[subprocess.Popen[str], Queue[str | None]]] = {}
    try:
        while units or running:
            while units and len(running) < at_once:
                name = next(iter(units))
                command = [sys.executable, "-c", units.pop(name)]
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
