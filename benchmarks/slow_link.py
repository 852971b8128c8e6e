"""A slow link to a server of this computer: one bottleneck for all connections, and a way."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from typing import Final

_PIECE: Final = 1460
"""Bytes of a packet, which is sent as a whole."""
_WAITING: Final = 32
"""Packets that the bottleneck keeps of each connection; a sender of more has to wait."""


class _Bottleneck:
    """One direction: packets of all connections one after the other, each underway for a while."""

    def __init__(self, bytes_per_s: float, delay_s: float) -> None:
        self._bytes_per_s = bytes_per_s
        self._delay_s = delay_s
        self._free_s = 0.0

    async def carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry one connection's bytes until it ends."""
        arriving: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(_WAITING)
        delivery = asyncio.create_task(self._deliver(arriving, writer))
        loop = asyncio.get_running_loop()
        with contextlib.suppress(OSError):
            while data := await reader.read(_PIECE):
                self._free_s = max(self._free_s, loop.time()) + len(data) / self._bytes_per_s
                sent_s = self._free_s
                await asyncio.sleep(sent_s - loop.time())
                await arriving.put((sent_s + self._delay_s, data))
        await arriving.put((loop.time() + self._delay_s, b""))
        await delivery

    async def _deliver(
        self, arriving: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter
    ) -> None:
        loop = asyncio.get_running_loop()
        with contextlib.suppress(OSError):
            while True:
                due_s, data = await arriving.get()
                await asyncio.sleep(due_s - loop.time())
                if not data:
                    break
                writer.write(data)
        writer.close()


@contextlib.contextmanager
def slow_link(port: int, bits_per_s: float, delay_s: float) -> Iterator[int]:
    """Yield the port of a link to a server at `port` of this computer.

    Parameters
    ----------
    port
        Of the server.
    bits_per_s
        Rate of each direction [bit/s].
    delay_s
        Time that a packet is underway, each way [s].
    """
    begun, ended = threading.Event(), threading.Event()
    ports = []

    async def serve() -> None:
        there, back = (_Bottleneck(bits_per_s / 8.0, delay_s) for _ in range(2))

        async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            other_reader, other_writer = await asyncio.open_connection("127.0.0.1", port)
            with contextlib.suppress(asyncio.CancelledError):  # the link ends
                await asyncio.gather(
                    there.carry(reader, other_writer), back.carry(other_reader, writer)
                )

        server = await asyncio.start_server(connected, "127.0.0.1", 0)
        ports.append(server.sockets[0].getsockname()[1])
        begun.set()
        while not ended.is_set():
            await asyncio.sleep(0.05)
        server.close()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    begun.wait()
    try:
        yield ports[0]
    finally:
        ended.set()
        thread.join()
