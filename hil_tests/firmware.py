"""firmware_sim as a process, forked from one that has loaded it, for that takes seconds."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path

_FORKS = multiprocessing.get_context("forkserver")
_FORKS.set_forkserver_preload(["hil_tests.firmware_loaded"])


class Firmware:
    """A process of firmware_sim.

    Parameters
    ----------
    arguments
        Of `python -m firmware_sim`.
    log
        Where its output goes, added to what is there.
    """

    def __init__(self, arguments: Sequence[str], log: Path) -> None:
        console, self._console = _FORKS.Pipe(duplex=False)
        self._process = _FORKS.Process(
            target=_run, args=(list(arguments), console, str(log)), daemon=True
        )
        self._process.start()
        console.close()

    @property
    def pid(self) -> int:
        """The process id."""
        assert self._process.pid is not None
        return self._process.pid

    def tell(self, line: str) -> None:
        """Write a line to its standard input."""
        os.write(self._console.fileno(), line.encode() + b"\n")

    def poll(self) -> int | None:
        """Return the exit status, minus the signal that ended it; None while it runs."""
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def wait(self, timeout: float) -> int:
        """Wait for the end; return the exit status."""
        self._process.join(timeout)
        status = self.poll()
        assert status is not None, f"firmware_sim runs on after {timeout} s"
        self._console.close()
        return status


def _run(arguments: list[str], console: Connection, log: str) -> None:
    """Be `python -m firmware_sim` with standard input and output of its own."""
    threading.Thread(target=_end_with_the_tests, daemon=True).start()
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for source, standard in ((console.fileno(), 0), (output, 1), (output, 2)):
        os.dup2(source, standard)
    from firmware_sim.__main__ import main

    sys.exit(main(arguments))


def _end_with_the_tests() -> None:
    """End this process when that of the tests has ended, however it did."""
    tests = multiprocessing.parent_process()
    assert tests is not None
    wait([tests.sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
