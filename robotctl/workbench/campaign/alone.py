"""One run in a process of its own, forked from a server that has loaded what a run needs.

A fresh process for each run: nothing of one run reaches the next, and one that dies or hangs costs
itself. Modules and kernels are loaded once, by the server, whose memory the runs share.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from typing import Final

import msgspec

DRIVEN: Final = (0, 3)
"""Statuses of `robotctl sim` with a report: completed, or not."""
REFUSED: Final = 2
"""Status of bad input."""
_PR_SET_PDEATHSIG: Final = 1


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
    """

    report: bytes = b""
    reason: str = ""
    is_refused: bool = False


class _Processes:
    """The server that runs are forked from, and the runs of this process."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        """Two threads must not ask for the exit code of a process at once: one would get none."""
        self.is_stopped = False
        self._running: set[ForkServerProcess] = set()
        self._context: ForkServerContext | None = None

    def start(self, program: Program, words: Sequence[str], folder: str) -> ForkServerProcess:
        """Start a run."""
        with self.lock:
            if self._context is None:
                self._context = multiprocessing.get_context("forkserver")
                self._context.set_forkserver_preload([program.warm or program.main.__module__])
                # A worker of Dask is a daemon, which may have no children: these end with it.
                vars(multiprocessing.process.current_process())["_config"]["daemon"] = False
            process = self._context.Process(
                target=_drive, args=(program.main, tuple(words), folder)
            )
            process.start()
            self._running.add(process)
        return process

    def end(self, process: ForkServerProcess) -> int | None:
        """Kill a process that still runs; return its exit code, None if it had to be killed."""
        with self.lock:
            code = process.exitcode
            if code is None:
                process.kill()
            process.join()
            process.close()
            self._running.discard(process)
        return code

    def stop(self) -> None:
        """Kill all runs, and start no more."""
        with self.lock:
            self.is_stopped = True
            for process in self._running:
                process.kill()


_processes = _Processes()


def run_alone(program: Program, words: Sequence[str], wall_seconds: float) -> Ending:
    """Run `robotctl WORDS --report FILE` in a process of its own; return how it ended.

    Parameters
    ----------
    program
        `robotctl`.
    words
        Arguments of it: a command that writes a report.
    wall_seconds
        Time after which it is killed [s].
    """
    if _processes.is_stopped:
        return Ending(reason="stopped before it began")
    try:
        with tempfile.TemporaryDirectory(prefix="robotctl-run-") as folder:
            process = _processes.start(program, words, folder)
            wait([process.sentinel], wall_seconds)
            code = _processes.end(process)
            said = _last_line(Path(folder, _OUTPUT))
            if code in DRIVEN:
                return Ending(report=Path(folder, _REPORT).read_bytes())
    except OSError as error:
        return Ending(reason=f"this computer refused: {error.strerror or error}")
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
        _processes.stop()
        raise
    finally:
        wait_for_all()
        _processes.is_stopped = False


_REPORT: Final = "report.json"
_OUTPUT: Final = "output"


def _last_line(file: Path) -> str:
    """Return the last line of a file that is not empty; the reason of a failure is there."""
    lines = file.read_text(encoding="utf-8", errors="replace").split("\n") if file.exists() else []
    return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")


def _drive(main: Callable[[], None], words: Sequence[str], folder: str) -> None:
    """Be `robotctl WORDS`."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the campaign
    output = os.open(Path(folder, _OUTPUT), os.O_WRONLY | os.O_CREAT, 0o600)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.environ["TMPDIR"] = tempfile.tempdir = folder
    sys.argv = ["robotctl", *words, "--report", str(Path(folder, _REPORT))]
    main()
