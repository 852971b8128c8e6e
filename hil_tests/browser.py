"""A page of a browser, as the web server meets it: by the foreign client of `websockets`."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

STICKS_S = 0.05
"""Period of sticks."""


class Page:
    """One page: it reads all it is sent, and sends its sticks from a thread of its own.

    Parameters
    ----------
    url
        Address of the page.
    path
        `/live` or `/stop`.
    port
        Where the connection goes instead of the page's own port; None: there.
    """

    def __init__(self, url: str, path: str = "/live", port: int | None = None) -> None:
        self.seen: dict[str, dict[str, Any]] = {}
        """Newest message of each type."""
        self.refused: list[str] = []
        self.sample_ns = 0
        """When the newest sample of the input device was taken."""
        self._sample = 0
        self._axes: tuple[bool, float, float] | None = None
        self._stands = self._quiet = False
        self._ws = connect(
            url.replace("http", "ws", 1).rstrip("/") + path,
            origin=url.rstrip("/"),
            compression=None,
            close_timeout=0.5,
            sock=None if port is None else socket.create_connection(("127.0.0.1", port)),
        ).__enter__()
        self._threads = [threading.Thread(target=each) for each in (self._read, self._steer)]
        self._ended = threading.Event()
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._ws.close()
        for thread in self._threads:
            thread.join(5.0)

    def send(self, _kind: str, **fields: Any) -> None:
        """Send one message."""
        self._ws.send(msgspec.json.encode({"type": _kind, **fields}).decode())

    @property
    def at_ms(self) -> float:
        """The present by the server's clock, which is this computer's."""
        return time.monotonic_ns() / 1e6

    def hold(self, forward: float, turn: float) -> None:
        """Hold the dead-man key and the sticks from now on."""
        self._axes = (True, forward, turn)

    def release(self) -> None:
        """Release the key."""
        self._axes = (False, 0.0, 0.0)

    def stand_still(self) -> None:
        """Let the input device repeat its last sample for ever, as a pad without its radio."""
        self._stands = True

    def fall_silent(self) -> None:
        """Send nothing any more, as behind a cut network: the connection does not end."""
        self._quiet = True

    def die(self) -> None:
        """End as a browser that is killed: the kernel closes its socket."""
        self._quiet = True
        self._ws.socket.shutdown(2)

    def _read(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                for message in msgspec.msgpack.decode(self._ws.recv()):
                    self.seen[message["type"]] = message
                    if message["type"] == "Refused":
                        self.refused.append(message["reason"])

    def _steer(self) -> None:
        with suppress(ConnectionClosed, OSError):
            while not self._ended.wait(STICKS_S):
                if self._axes is None or self._quiet:
                    continue
                held, forward, turn = self._axes
                if not self._stands:
                    self._sample += 1
                    self.sample_ns = time.monotonic_ns()
                self.send(
                    "Sticks",
                    sample=self._sample,
                    at_ms=self.at_ms,
                    held=held,
                    forward=forward,
                    turn=turn,
                    sideways=0.0,
                )
