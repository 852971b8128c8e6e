"""One run in a process of its own, forked from a server that has loaded what a run needs.

A fresh process for each run: nothing of one run reaches the next, and one that dies or hangs costs
itself. Modules and kernels are loaded once, by the server, whose memory the runs share.
"""

from __future__ import annotations

import errno
import fcntl
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from typing import Any, Final

import msgspec

from robotctl.app.supervision.child_process import end_with

DRIVEN: Final = (0, 3)
"""Statuses of `robotctl sim` with a report: completed, or not."""
REFUSED: Final = 2
"""Status of bad input."""


@dataclass(frozen=True, slots=True)
class Program:
    """The program that is run.

    Attributes
    ----------
    main
        `robotctl` itself: takes its arguments from `sys.argv`, and ends with SystemExit.
    warm
        Name of a module that the server imports, so that what runs need is loaded once.
    """

    main: Callable[[], None]
    warm: str = ""


class Ending(msgspec.Struct, frozen=True):
    """How a run ended.

    Attributes
    ----------
    report
        Its report, as `robotctl sim` wrote it; empty if it has none.
    reason
        Why it has none.
    is_refused
        Whether the reason is its input: it would be the same each time.
    is_disk_full
        Whether the reason is the disk of its computer.
    worker
        Where it ran; empty: on this computer.
    """

    report: bytes = b""
    reason: str = ""
    is_refused: bool = False
    is_disk_full: bool = False
    worker: str = ""


class _Processes:
    """The server that runs are forked from, and the runs of this process."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        """Two threads must not ask for the exit code of a process at once: one would get none."""
        self.stopped: set[str] = set()
        self._running: dict[ForkServerProcess, str] = {}
        self._context: ForkServerContext | None = None

    def start(self, program: Program, arguments: tuple[Any, ...], owner: str) -> ForkServerProcess:
        """Start a run; `arguments`: those of `_drive` behind the program's main."""
        with self.lock:
            if self._context is None:
                clear_abandoned()
                self._context = multiprocessing.get_context("forkserver")
                self._context.set_forkserver_preload([program.warm or program.main.__module__])
                # A worker of Dask is a daemon, which may have no children: these end with it.
                vars(multiprocessing.process.current_process())["_config"]["daemon"] = False
            process = self._context.Process(target=_drive, args=(program.main, *arguments))
            process.start()
            self._running[process] = owner
        return process

    def end(self, process: ForkServerProcess) -> int | None:
        """Kill a process that still runs; return its exit code, None if it had to be killed."""
        with self.lock:
            code = process.exitcode
            if code is None:
                process.kill()
            process.join()
            process.close()
            self._running.pop(process, None)
        return code

    def stop(self, owner: str) -> None:
        """Kill all runs of an owner, and start no more."""
        with self.lock:
            self.stopped.add(owner)
            for process, its_owner in self._running.items():
                if its_owner == owner:
                    process.kill()


_processes = _Processes()


def run_alone(
    program: Program,
    words: Sequence[str],
    wall_seconds: float,
    owner: str = "",
    processors: frozenset[int] = frozenset(),
) -> Ending:
    """Run `robotctl WORDS --report FILE` in a process of its own; return how it ended.

    Parameters
    ----------
    program
        `robotctl`.
    words
        Arguments of it: a command that writes a report.
    wall_seconds
        Time after which it is killed [s].
    owner
        Campaign whose runs can be stopped together, see `stop_runs`.
    processors
        Those it may use; empty: all that this process may.
    """
    if owner in _processes.stopped:
        return Ending(reason="stopped before it began")
    try:
        with (
            tempfile.TemporaryDirectory(prefix=_PREFIX) as folder,
            Path(folder, _LOCK).open("wb") as held,
        ):
            fcntl.flock(held, fcntl.LOCK_EX)
            process = _processes.start(program, (tuple(words), folder, processors), owner)
            wait([process.sentinel], wall_seconds)
            code = _processes.end(process)
            said = _last_line(Path(folder, _OUTPUT))
            if code in DRIVEN:
                return Ending(report=Path(folder, _REPORT).read_bytes())
            is_full = shutil.disk_usage(folder).free < _LEAST_FREE
    except OSError as error:
        reason = f"this computer refused: {error.strerror or error}"
        return Ending(reason=reason, is_disk_full=error.errno in _DISK_FULL)
    if is_full:
        return Ending(reason=f"{tempfile.gettempdir()} is full", is_disk_full=True)
    if code is None:
        return Ending(reason=f"not over after {wall_seconds:g} s of this computer's time")
    if code < 0:
        return Ending(reason=f"its process was ended by {signal.Signals(-code).name}")
    return Ending(reason=f"status {code}: {said}", is_refused=code == REFUSED)


@contextmanager
def runs_end_with_this(wait_for_all: Callable[[], None]) -> Iterator[None]:
    """Kill the runs of this process, and start no more, if an exception ends the context.

    At its end `wait_for_all` returns once nobody waits for a run.
    """
    try:
        yield
    except BaseException:
        stop_runs("")
        raise
    finally:
        wait_for_all()
        _processes.stopped.discard("")


def stop_runs(owner: str) -> None:
    """Kill the runs of an owner in this process, and start no more of them."""
    _processes.stop(owner)


_PREFIX: Final = "robotctl-run-"
_DISK_FULL: Final = (errno.ENOSPC, errno.EDQUOT)
_LEAST_FREE: Final = 1 << 20
"""A run that fails with less space than this may have failed for it [bytes]."""
_LOCK: Final = "lock"
"""File in the folder of a run, held by the process that waits for the run."""
_REPORT: Final = "report.json"
_OUTPUT: Final = "output"


def clear_abandoned() -> None:
    """Remove the folders of runs whose process was killed before it could."""
    for lock in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*/{_LOCK}"):
        with suppress(OSError), lock.open("r+b") as file:  # held, another user's, or just removed
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(lock.parent)


def _last_line(file: Path) -> str:
    """Return the last line of a file that is not empty; the reason of a failure is there."""
    lines = file.read_text(encoding="utf-8", errors="replace").split("\n") if file.exists() else []
    return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")


def _drive(
    main: Callable[[], None], words: Sequence[str], folder: str, processors: frozenset[int]
) -> None:
    """Be `robotctl WORDS`."""
    end_with(os.getppid(), signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the campaign
    if processors:
        os.sched_setaffinity(0, processors)
    output = os.open(Path(folder, _OUTPUT), os.O_WRONLY | os.O_CREAT, 0o600)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.environ["TMPDIR"] = tempfile.tempdir = folder
    sys.argv = ["robotctl", *words, "--report", str(Path(folder, _REPORT))]
    main()
