"""The real control process over the real simcan hub process, driving a circle in an empty room."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import zmq

from robotctl.app.supervision.stack import CONTROL
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.messages.control import Arm, ControlState, Notice, SafetyState, VelocityCommand
from robotctl.runtime.ipc.topics import Endpoints, RequestSender, Subscriber, endpoint_directory
from robotctl.safety.state_machine import LATCHED, POWERED

_COMMAND_S = 0.05
_numbers = itertools.count()


class RoundError(Exception):
    """A process did not start or did not answer, so that the round says nothing."""


class Driven:
    """Firmware and control process of one round; `drive` makes the robot go in a circle.

    Parameters
    ----------
    rate_hz
        Control rate [Hz].
    module
        What to run as the control process; "" for none.
    overrides
        Settings of the robot.

    Attributes
    ----------
    instance
        Name of the robot.
    """

    def __init__(
        self, rate_hz: int, module: str = CONTROL, overrides: tuple[str, ...] = ()
    ) -> None:
        self.instance = name = f"bench-{os.getpid()}-{next(_numbers)}"
        self._options = StackOptions(
            instance=name,
            robot=str(find_file("diff_drive").resolve()),
            overrides=(
                'can.interface="simcan"',
                f'can.channel="{name}"',
                "mavlink.link=[]",
                f"runtime.rate_hz={rate_hz}",
                # A stall of the machine shall show in the figures and stop the robot seldom.
                "safety.feedback_timeout_periods=10",
                "safety.command_timeout_ms=400",
                "runtime.allow_best_effort=true",
                *overrides,
            ),
            x_m=2.0,
            y_m=2.0,
        )
        self._module = module
        config = self._options.load()
        self._firmware_priority = max(0, config.runtime.priority - 10)
        self._endpoints = Endpoints(endpoint_directory(name))
        self._processes: list[subprocess.Popen[str]] = []
        self.control: ControlState | None = None
        self.stops = 0
        self.pid = 0

    def __enter__(self) -> Driven:
        """Start firmware, then control; without a module, firmware alone."""
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._states = Subscriber[ControlState | Notice](
            self._context, (self._endpoints.control_state,), ControlState | Notice
        )
        self._requests = RequestSender(self._context, self._endpoints.control_requests)
        try:
            self._start_firmware()
            if self._module:
                command = self._options.command(self._module)
                process = subprocess.Popen(command, stdin=subprocess.DEVNULL, text=True)
                self._processes.append(process)
                self.pid = process.pid
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        """End what was started, control first."""
        for process in reversed(self._processes):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(3.0)
            process.kill()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()
        self._context.destroy(linger=0)

    def _start_firmware(self) -> None:
        channel = f"simcan:{self._options.instance}"
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "firmware_sim", "--robot", self._options.robot),
                *("--world", str(find_file("empty_room", "worlds")), "--start=2,2,0"),
                *("--bus", channel, "--priority", str(self._firmware_priority)),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._processes.append(process)
        if process.stdout is None or not process.stdout.readline().startswith("ready"):
            raise RoundError("firmware_sim did not start")

    def drive(self, seconds: float, *, end: bool = True) -> ControlState:
        """Arm, drive a circle, `end` the control process in order and return its last state.

        Where the robot latches, because the machine stood still for ten periods, it is armed
        again; `stops` counts it.
        """
        self._wait(lambda: self._state is SafetyState.STANDBY, 10.0)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            now_ns = time.monotonic_ns()
            if self._state in POWERED:
                self._requests.send(VelocityCommand(now_ns, now_ns + 500_000_000, 0.4, 0.8))
            else:
                self.stops += self._state in LATCHED
                self._requests.send(Arm(now_ns, next(_numbers), arm=True))
            time.sleep(_COMMAND_S)
            self._listen()
        if end:
            control = self._processes[-1]
            control.terminate()
            self._wait(lambda: control.poll() is not None, 5.0)
        if self.control is None:
            raise RoundError("nothing heard")
        return self.control

    def resident_mib(self) -> dict[str, float]:
        """Return the memory figures of the control process [MiB]: now and at its peak."""
        lines = Path(f"/proc/{self.pid}/status").read_text(encoding="ascii").splitlines()
        fields = dict(line.split(":", 1) for line in lines)
        return {name: int(fields[name].split()[0]) / 1024 for name in ("VmRSS", "VmHWM", "VmLck")}

    @property
    def _state(self) -> SafetyState | None:
        return self.control.state if self.control else None

    def _listen(self) -> None:
        for message in self._states.receive():
            if isinstance(message, ControlState):
                self.control = message

    def _wait(self, condition: Callable[[], bool], seconds: float) -> None:
        deadline_s = time.monotonic() + seconds
        while not condition():
            self._listen()
            if time.monotonic() > deadline_s:
                raise RoundError(self.control.reason if self.control else "nothing heard")
            time.sleep(0.02)
        self._listen()
