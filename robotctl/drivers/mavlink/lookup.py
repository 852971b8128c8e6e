"""Host names without waiting: an unreachable name server must not stop the other links."""

from __future__ import annotations

import socket
import threading
from typing import Any, NamedTuple


class SocketAddress(NamedTuple):
    """Arguments of `socket.socket` and `connect` or `bind`."""

    family: socket.AddressFamily
    sockaddr: tuple[Any, ...]


class HostLookup:
    """Looks up one host; numeric addresses at once, names in a thread of their own.

    Parameters
    ----------
    host : str
        Name, IPv4 or IPv6 address.
    port : int
        Port, 0 to 65535.
    kind : socket.SocketKind
        SOCK_DGRAM or SOCK_STREAM.
    """

    def __init__(self, host: str, port: int, kind: socket.SocketKind) -> None:
        self._query = (host, port, kind)
        self._answer: SocketAddress | OSError | None = None
        try:
            self._answer = _look_up(host, port, kind, socket.AI_NUMERICHOST)
        except socket.gaierror:
            threading.Thread(target=self._ask, name=f"lookup {host}", daemon=True).start()
        except UnicodeError as error:  # no name at all, such as one with two dots in a row
            self._answer = OSError(f"{host}: {error}")

    def _ask(self) -> None:
        try:
            self._answer = _look_up(*self._query, 0)
        except (OSError, UnicodeError) as error:
            self._answer = OSError(f"{self._query[0]}: {error}")

    def result(self) -> SocketAddress | None:
        """Return the address, None while the answer is awaited.

        Raises
        ------
        OSError
            If the name is not known.
        """
        if isinstance(self._answer, OSError):
            raise self._answer
        return self._answer


def _look_up(host: str, port: int, kind: socket.SocketKind, flags: int) -> SocketAddress:
    """Return the first address, IPv4 before IPv6: ground stations listen on 127.0.0.1."""
    answers = socket.getaddrinfo(host, port, type=kind, flags=flags)
    found = min(answers, key=lambda answer: answer[0] != socket.AF_INET)
    return SocketAddress(found[0], found[4])
