"""A service's notifications to systemd: sd_notify(3), by datagrams to the socket NOTIFY_SOCKET."""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping
from typing import Final

_FEEDS_PER_TIMEOUT: Final = 4


class ServiceNotifier:
    """Reports readiness, state and progress; does nothing if no service manager listens.

    Takes the variables out of the environment, so that no child reports in this process's place.

    Parameters
    ----------
    environment
        Environment variables, usually `os.environ`.
    """

    def __init__(self, environment: MutableMapping[str, str]) -> None:
        address = environment.pop("NOTIFY_SOCKET", "")
        timeout_us = environment.pop("WATCHDOG_USEC", "")
        process = environment.pop("WATCHDOG_PID", "")
        mine = process in {"", str(os.getpid())}
        self.feed_s = int(timeout_us) / 1e6 / _FEEDS_PER_TIMEOUT if timeout_us and mine else None
        """Period of the watchdog [s]; None: there is none."""
        self._status = ""
        self._socket: socket.socket | None = None
        if address.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
            self._address = "\0" + address[1:] if address.startswith("@") else address

    def ready(self) -> bool:
        """Report the end of the start; return False if this must be repeated."""
        return self._send("READY=1")

    def stopping(self) -> None:
        """Report the begin of the shutdown."""
        self._send("STOPPING=1")

    def feed_watchdog(self) -> None:
        """Report progress to the watchdog."""
        self._send("WATCHDOG=1")

    def status(self, line: str) -> None:
        """Report the state in one line; a repeated line is sent once."""
        if line != self._status and self._send("STATUS=" + line.replace("\n", " ")):
            self._status = line

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str) -> bool:
        """Send one datagram without waiting; return False if the manager's queue is full.

        A missing manager is no reason to stop a robot.
        """
        if self._socket is None:
            return True
        try:
            self._socket.sendto(text.encode(), self._address)
        except BlockingIOError:
            return False
        except OSError:
            return True
        return True
