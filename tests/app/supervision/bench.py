"""The processes of a robot, run by tests on a simulated bus without nodes."""

import contextlib
import os
import pty
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zmq

from robotctl.messages.control import ControlState, NavigationState, Notice, SafetyState
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Subscriber,
    endpoint_directory,
)

DEADLINE_S = 40.0


def wait(condition: Callable[[], Any], what: str) -> Any:
    deadline_s = time.monotonic() + DEADLINE_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what
        time.sleep(0.01)
    return found


class Ear:
    """Hears the control process's state."""

    def __init__(self, instance: str) -> None:
        self.context: zmq.Context = zmq.Context()
        kinds = ControlState | NavigationState | Notice
        endpoints = Endpoints(endpoint_directory(instance))
        self.subscriber = Subscriber(self.context, endpoints.published, kinds)

    def newest(self) -> ControlState | None:
        states = [each for each in self.subscriber.receive() if isinstance(each, ControlState)]
        return states[-1] if states else None

    def is_in(self, state: SafetyState) -> bool:
        newest = self.newest()
        return newest is not None and newest.state is state


def overrides(channel: str) -> tuple[str, ...]:
    bus = ('can.interface="simcan"', f'can.channel="{channel}"')
    return (*bus, "mavlink.link=[]", "runtime.allow_best_effort=true")


class Run:
    """`robotctl run` on a terminal of its own."""

    def __init__(self, channel: str, record: Path, manager: Path, link: str = "") -> None:
        self.record = record
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.bind(str(manager))
        self.manager.setblocking(False)
        service = {"NOTIFY_SOCKET": str(manager), "WATCHDOG_USEC": "400000"}
        self.terminal, child = pty.openpty()

        def take_terminal() -> None:
            os.setsid()
            os.close(os.open(os.ttyname(child), os.O_RDWR))

        links = (f'mavlink.link=[{{url="{link}"}}]',) if link else ()
        given = (*overrides(channel), *links)
        settings = [part for each in given for part in ("--set", each)]
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-c", "from robotctl.cli.main import main; main()", "run"),
                *("--record", str(record), *settings),
            ],
            stdin=child,
            stdout=child,
            stderr=child,
            env=os.environ | service,
            preexec_fn=take_terminal,  # noqa: PLW1509 - nothing but system calls
        )
        os.close(child)
        os.set_blocking(self.terminal, False)
        self.output = self.status = ""
        self.ready = False

    def said(self, words: str) -> bool:
        with contextlib.suppress(BlockingIOError, OSError):
            self.output += os.read(self.terminal, 65536).decode()
        return words in self.output

    def told(self) -> list[str]:
        """Return what systemd was told since the last call."""
        lines = []
        with contextlib.suppress(BlockingIOError):
            while True:
                lines.append(self.manager.recv(4096).decode())
        self.ready |= "READY=1" in lines
        self.status = ([each for each in lines if each.startswith("STATUS=")] or [self.status])[-1]
        return lines

    def child(self, module: str) -> int:
        """Return the process id of a child, as the kernel knows it."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        for pid in path.read_text().split():
            if module in Path(f"/proc/{pid}/cmdline").read_text():
                return int(pid)
        raise AssertionError(f"no {module} below {self.process.pid}")
