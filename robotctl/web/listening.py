"""Listening socket of the server, and the limits on connections."""

from __future__ import annotations

import asyncio
import socket
import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import uvicorn
from starlette.types import ASGIApp
from uvicorn._types import ASGISendEvent
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from robotctl.errors import LinkError
from robotctl.web.config import LAST_PORT, WebConfig
from robotctl.web.pages import MAX_MESSAGE_BYTES
from robotctl.web.plan_uploads import MAX_PLAN_BYTES
from robotctl.web.rate import RateLimit

PORTS: Final = 100
"""Ports that are tried, from the configured one on."""
SENT_BYTES: Final = 64 * 1024
"""Buffer of the kernel for a client, which it doubles: pictures that lie there are late."""
UNHEARD_MS: Final = 10_000
"""Time after which the kernel ends a connection that takes no data [ms]."""
MAX_CONNECTIONS: Final = 128
MAX_CONNECTIONS_OF_ONE: Final = 48
"""Most connections of one address."""
HEAD_S: Final = 5.0
"""Time that a connection has to ask for something [s]."""
RECEIVED_BYTES: Final = 8 * 1024
"""Buffer of the kernel for what a client sends, which it doubles: all of it may be read at once."""
BYTES_PER_S, BYTES_AT_ONCE = 16 * 1024, 8 * 1024
"""Most that a client sends; a page sends a fifth of that while it drives."""
POST_AT_ONCE: Final = MAX_PLAN_BYTES + BYTES_AT_ONCE
"""Most that a connection that is no socket sends at once: one plan, and its headers."""
NEW_PER_S, NEW_AT_ONCE = 2, 64
"""Most new connections of one address."""
CLOSING_S: Final = 2.0
"""Time that a client has to close a socket that the server closed [s]."""
_MOST_ADDRESSES: Final = 256


def listen(config: WebConfig, first: int | None = None) -> socket.socket:
    """Return a listening socket at the configured port, or the next free one.

    Parameters
    ----------
    config
        The address.
    first
        Port that is tried before; None: none.

    Raises
    ------
    LinkError
        If there is no free one.
    """
    host = "127.0.0.1" if config.host == "localhost" else config.host
    ports = range(config.port, min(config.port + PORTS, LAST_PORT + 1)) if config.port else (0,)
    why = ""
    for port in ports if first is None else (first, *ports):
        try:
            return _bound(host, port)
        except OSError as error:
            why = error.strerror or str(error)
    raise LinkError(f"web page: not at {config.host}, ports {ports[0]} to {ports[-1]}: {why}")


def _bound(host: str, port: int) -> socket.socket:
    is_v6 = ":" in host
    listener = socket.socket(socket.AF_INET6 if is_v6 else socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SENT_BYTES)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVED_BYTES)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNHEARD_MS)
        if is_v6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.bind((host, port))
        listener.listen(MAX_CONNECTIONS)
    except OSError:
        listener.close()
        raise
    return listener


def address_towards_others(host: str) -> str:
    """Return the address under which others reach a server that listens at `host`."""
    if host not in ("0.0.0.0", "::"):  # noqa: S104 - compared, not bound
        return host
    family, far = (socket.AF_INET, "192.0.2.1") if host != "::" else (socket.AF_INET6, "2001:db8::")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))  # sends nothing: the kernel only looks up the route
        except OSError:
            return "127.0.0.1" if host != "::" else "::1"
        return str(probe.getsockname()[0])


class _NewConnections:
    """How often each address may connect."""

    def __init__(self) -> None:
        self._limits: OrderedDict[str, RateLimit] = OrderedDict()

    def allows(self, host: str) -> bool:
        """Count a connection; return whether it is within the limit."""
        limit = self._limits.setdefault(host, RateLimit(NEW_PER_S, NEW_AT_ONCE))
        self._limits.move_to_end(host)
        if len(self._limits) > _MOST_ADDRESSES:
            self._limits.popitem(last=False)
        return limit.allows(time.monotonic_ns())


class _BoundedHttp(H11Protocol):
    """HTTP with an end to connections that are too many, too fast, or ask for nothing."""

    news: _NewConnections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, or drop it."""
        super().connection_made(transport)
        self._limit = RateLimit(BYTES_PER_S, POST_AT_ONCE)
        hosts = [(getattr(each, "client", None) or ("",))[0] for each in self.connections]
        host = self.client[0] if self.client else ""
        of_one = hosts.count(host)
        is_new = self.news.allows(host)
        if len(hosts) > MAX_CONNECTIONS or of_one > MAX_CONNECTIONS_OF_ONE or not is_new:
            transport.abort()
        else:
            self.loop.call_later(HEAD_S, self._end_if_idle)

    def data_received(self, data: bytes) -> None:
        """Take what came; drop a client that sends too much."""
        if self._limit.allows(time.monotonic_ns(), len(data)):
            super().data_received(data)
        else:
            self.transport.abort()

    def _end_if_idle(self) -> None:
        """Close a connection that has asked for nothing."""
        if self.scope is None:
            self.transport.close()


class _BoundedSocket(WebSocketsSansIOProtocol):
    """WebSocket with an end to clients that send too much, or on after they were closed.

    What is judged here costs nothing to read; frames are judged one by one, and some never reach
    the application.
    """

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a connection."""
        super().connection_made(transport)
        self.close_timeout = CLOSING_S
        self._limit = RateLimit(BYTES_PER_S, BYTES_AT_ONCE)
        self._will_write = False

    def data_received(self, data: bytes) -> None:
        """Take what came; drop a client that sends too much."""
        if self._limit.allows(time.monotonic_ns(), len(data)):
            super().data_received(data)
        else:
            self.transport.abort()

    async def send(self, message: ASGISendEvent) -> None:
        """Send a message; all of one round of the loop go to the kernel at once."""
        data = message.get("bytes")
        if message["type"] != "websocket.send" or not isinstance(data, bytes) or self.close_sent:
            await super().send(message)
            return
        await self.writable.wait()
        if self.disconnected:
            raise ClientDisconnected
        self.conn.send_binary(data)
        if not self._will_write:
            self._will_write = True
            self.loop.call_soon(self._write)

    def _write(self) -> None:
        """Hand all frames to the kernel."""
        self._will_write = False
        output = self.conn.data_to_send()
        if output and not self.transport.is_closing():
            self.transport.write(b"".join(output))


class PageHost(uvicorn.Server):
    """Uvicorn for one application, in a process that takes signals itself.

    Parameters
    ----------
    app
        The application.
    certificate, key
        Files for TLS; None: plain HTTP.
    """

    def __init__(
        self, app: ASGIApp, certificate: Path | None = None, key: Path | None = None
    ) -> None:
        config = uvicorn.Config(
            app,
            http=type("Http", (_BoundedHttp,), {"news": _NewConnections()}),
            ws=_BoundedSocket,
            ws_max_size=MAX_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=5.0,
            ws_ping_timeout=10.0,
            lifespan="off",
            log_config=None,
            log_level="error",
            access_log=False,
            server_header=False,
            date_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=1,
            ssl_certfile=certificate,
            ssl_keyfile=key,
        )
        super().__init__(config)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone."""
        yield
