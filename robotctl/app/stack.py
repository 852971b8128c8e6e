"""The processes of one robot: started in order, watched, ended with the motors off first."""

from __future__ import annotations

import subprocess
import time
from dataclasses import dataclass, field

from robotctl.app.children import start_child
from robotctl.app.options import StackOptions
from robotctl.errors import RobotctlError

CONTROL = "robotctl.app.control"
NAVIGATION = "robotctl.app.navigation"
TELEMETRY = "robotctl.app.telemetry"

_RESTART_DELAY_S = 1.0
_END_S = 3.0


class StackError(RobotctlError):
    """A process of the robot ended that the robot cannot do without."""


@dataclass(slots=True)
class _Child:
    """One process and when it may be started again."""

    module: str
    process: subprocess.Popen[bytes]
    restarts: int = 0
    restart_at_s: float = field(default=0.0)


class Stack:
    """Control, navigation and telemetry as child processes.

    Navigation and telemetry are started again when they end; control is not, since whatever ended
    it may have left the robot in motion and only a person can say that it may move again.

    Parameters
    ----------
    options
        What the processes are started with.
    """

    def __init__(self, options: StackOptions) -> None:
        self._options = options
        self._children = [
            _Child(module, self._start(module)) for module in (CONTROL, NAVIGATION, TELEMETRY)
        ]

    def _start(self, module: str) -> subprocess.Popen[bytes]:
        """Start one process."""
        return start_child(self._options.command(module))

    def pid(self, module: str) -> int:
        """Return the process id of `module`."""
        return next(child.process.pid for child in self._children if child.module == module)

    def watch(self) -> list[str]:
        """Restart what ended and return a sentence for each; call some times a second.

        Raises
        ------
        StackError
            Where the control process ended, or another one ended because of its configuration.
        """
        lines = []
        now_s = time.monotonic()
        for child in self._children:
            status = child.process.poll()
            if status is None:
                continue
            name = child.module.rpartition(".")[2]
            if child.module == CONTROL or status == 2:
                raise StackError(f"the {name} process ended ({_status_words(status)})")
            if child.restart_at_s == 0.0:
                child.restart_at_s = now_s + _RESTART_DELAY_S
                lines.append(
                    f"{name} ended ({_status_words(status)}); starting it again in "
                    f"{_RESTART_DELAY_S:g} s"
                )
            elif now_s >= child.restart_at_s:
                child.process = self._start(child.module)
                child.restarts += 1
                child.restart_at_s = 0.0
        return lines

    def close(self) -> None:
        """End all processes, control first, and wait for them."""
        for child in self._children:
            child.process.terminate()
        deadline_s = time.monotonic() + _END_S
        for child in self._children:
            try:
                child.process.wait(max(0.0, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()


def _status_words(status: int) -> str:
    """Say how a process ended."""
    return f"signal {-status}" if status < 0 else f"exit status {status}"
