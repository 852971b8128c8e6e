"""Server of a replay: the page of the robot, and the recording in place of it."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from robotctl.web.access import HEADERS, Access, Role
from robotctl.web.assets import Assets
from robotctl.web.pages import asker_of
from robotctl.web.replay_wire import Align, Pause, Play, Playback, ReplayMessage, Seek
from robotctl.web.server import MAX_CLIENTS
from robotctl.web.wire import PROTOCOL, Hello, Ping, Pong, RecordedRun, encode, frame
from robotctl.workbench.view.playback import PlaybackClock
from robotctl.workbench.view.run import ReplayedRun

PERIOD_S: Final = 0.05
"""Time between two pictures while it plays [s]."""
MOST_FIELDS: Final = 24
"""Most fields that a page may ask for at once."""
_POLICY: Final = 1008
_PAGE: Final = "index.html"
_TAG: Final = b'<html lang="en"'

_HEADERS: Final = {
    **HEADERS,
    "Content-Security-Policy": HEADERS["Content-Security-Policy"].replace(
        "frame-ancestors 'none'", "frame-ancestors 'self'; frame-src 'self'"
    ),
    "X-Frame-Options": "SAMEORIGIN",
}
"""Headers of every answer: two runs are two frames of the server's own."""


@dataclass(eq=False, slots=True)
class _Client:
    """A page: the run it shows, and which pictures it has."""

    run: int | None
    woken: asyncio.Event = field(default_factory=asyncio.Event)
    sent: dict[str, object] = field(default_factory=dict)
    pongs: list[Pong] = field(default_factory=list)


class ReplayServer:
    """The application for one run, or two beside each other.

    All pages share one time.

    Parameters
    ----------
    runs
        The runs.
    access
        Who may look.
    static
        Folder of the page.
    """

    def __init__(self, runs: Sequence[ReplayedRun], access: Access, static: Path) -> None:
        self._runs = tuple(runs)
        self._access = access
        page = (static / _PAGE).read_bytes()
        marked = page.replace(_TAG, b'%s data-replay="%d"' % (_TAG, len(self._runs)))
        self._assets = Assets(static, {_PAGE: marked})
        self._clock = PlaybackClock([each.length_ns for each in self._runs])
        self._by_driving = False
        self._clients: set[_Client] = set()
        self._numbers = itertools.count(1)
        self._player: asyncio.Task[None] | None = None
        self._histories: dict[int, asyncio.Task[bytes]] = {}
        self._driving_ns: dict[int, int | None] = {}
        self._scanning = asyncio.Lock()
        self._decode = msgspec.json.Decoder(ReplayMessage).decode
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self._page),
                Route("/session", self._rights),
                Route("/assets/{name}", self._page),
                Route("/history", self._history),
                Route("/series", self._series),
                WebSocketRoute("/live", self._socket),
            ]
        )

    # Pictures

    async def _socket(self, socket: WebSocket) -> None:
        """Serve one page."""
        if objection := self._access.objection(asker_of(socket), needs_origin=True):
            refusal = PlainTextResponse(objection, 403, _HEADERS)
            await socket.send_denial_response(refusal)
            return
        await socket.accept()
        if len(self._clients) >= MAX_CLIENTS:
            await socket.close(_POLICY, f"{MAX_CLIENTS} pages are connected, no more allowed")
            return
        client = _Client(self._run_of(socket))
        client.woken.set()
        self._clients.add(client)
        sender = asyncio.create_task(self._send(socket, client))
        try:
            await self._receive(socket, client)
        finally:
            self._clients.discard(client)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)

    def _run_of(self, connection: HTTPConnection) -> int | None:
        """Return which run is asked for; None: the times of all of them."""
        if len(self._runs) == 1:
            return 0
        number = connection.query_params.get("run", "")
        return int(number) if number in map(str, range(len(self._runs))) else None

    async def _receive(self, socket: WebSocket, client: _Client) -> None:
        """Take messages until the connection ends, or one of them is none."""
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            try:
                self._take(client, self._decode(message.get("text") or ""))
            except (msgspec.DecodeError, UnicodeError) as error:
                await socket.close(_POLICY, f"no such message: {error}"[:120])
                return

    def _take(self, client: _Client, message: ReplayMessage) -> None:
        """Do what a page asks for."""
        match message:
            case Ping(t):
                client.pongs.append(Pong(t, time.monotonic_ns(), self._at_ns(client)))
                client.woken.set()
                return
            case Seek(at_ns):
                offset_ns = 0 if client.run is None else self._clock.offsets_ns[client.run]
                self._clock.seek(at_ns + offset_ns)
            case Play(rate):
                self._clock.play(rate, time.monotonic_ns())
                if self._player is None or self._player.done():
                    self._player = asyncio.create_task(self._play())
            case Pause():
                self._clock.pause()
            case Align(by_driving):
                self._align(by_driving=by_driving)
        self._wake()

    def _align(self, *, by_driving: bool) -> None:
        marks_ns = [self._driving_ns.get(number) or 0 for number in range(len(self._runs))]
        self._by_driving = by_driving
        self._clock.align(marks_ns if by_driving else [0] * len(marks_ns))

    async def _play(self) -> None:
        """Let the time go on."""
        while self._clock.is_playing:
            self._clock.step(time.monotonic_ns())
            self._wake()
            await asyncio.sleep(PERIOD_S)

    def _wake(self) -> None:
        for client in self._clients:
            client.woken.set()

    async def _send(self, socket: WebSocket, client: _Client) -> None:
        """Send what changed; a page that is slow is sent the newest once it has read the last."""
        try:
            await socket.send_bytes(frame([encode(self._hello(client))]))
            while True:
                await client.woken.wait()
                client.woken.clear()
                await socket.send_bytes(frame([*self._news(client)]))
        except (WebSocketDisconnect, RuntimeError):
            return

    def _hello(self, client: _Client) -> Hello:
        number = client.run or 0
        run = self._runs[number]
        name = run.name if client.run is not None else " | ".join(each.name for each in self._runs)
        return Hello(
            **msgspec.structs.asdict(run.outline),
            protocol=PROTOCOL,
            client=next(self._numbers),
            role=Role.LOOK,
            server_ns=time.monotonic_ns(),
            robot_ns=0,
            replay=RecordedRun(name, client.run, run.begin_ns, run.end_ns),
        )

    def _at_ns(self, client: _Client) -> int:
        return self._clock.at_ns if client.run is None else self._clock.of_run(client.run)

    def _news(self, client: _Client) -> Iterator[bytes]:
        """Yield the pictures that a page does not have, then the time that they are of."""
        pongs, client.pongs = client.pongs, []
        yield from map(encode, pongs)
        at_ns, names = self._at_ns(client), []
        if client.run is not None:
            run = self._runs[client.run]
            for picture in run.pictures(at_ns):
                made = run.made(picture)
                if not made:
                    continue
                names.append(picture.name)
                if client.sent.get(picture.name) != picture.key:
                    client.sent[picture.name] = picture.key
                    yield from made
            client.sent = {name: client.sent[name] for name in names}
        clock = self._clock
        end_ns = clock.end_ns if client.run is None else self._runs[client.run].length_ns
        playback = Playback(
            at_ns,
            end_ns,
            clock.rate,
            clock.is_playing,
            tuple(names),
            clock.offsets_ns,
            self._by_driving,
        )
        yield encode(playback)

    # Whole runs

    async def _history(self, request: Request) -> Response:
        """Return a whole run at once."""
        number = self._run_of(request)
        if refusal := self._refusal(request, number):
            return refusal
        number = number or 0
        if number not in self._histories:
            self._histories[number] = asyncio.create_task(self._read_history(number))
        return Response(await asyncio.shield(self._histories[number]), 200, _HEADERS)

    async def _read_history(self, number: int) -> bytes:
        async with self._scanning:
            history = await asyncio.to_thread(self._runs[number].history)
        self._driving_ns[number] = history.driving_ns
        self._wake()  # it is known now where the robot was while it was lost
        return msgspec.msgpack.encode(history)

    async def _series(self, request: Request) -> Response:
        """Return fields over a whole run."""
        number, names = self._run_of(request), request.query_params.getlist("field")
        if refusal := self._refusal(request, number):
            return refusal
        if not 0 < len(names) <= MOST_FIELDS:
            return PlainTextResponse(f"1 to {MOST_FIELDS} fields are needed", 400, _HEADERS)
        async with self._scanning:
            found = await asyncio.to_thread(self._runs[number or 0].series, names)
        return Response(msgspec.msgpack.encode(found), 200, _HEADERS)

    def _refusal(self, request: Request, number: int | None) -> Response | None:
        """Return the answer to a request that is not carried out; None: it is."""
        if objection := self._access.objection(asker_of(request), needs_origin=False):
            return PlainTextResponse(objection, 403, _HEADERS)
        if number is None:
            last = len(self._runs) - 1
            return PlainTextResponse(f"no such run: run=0 to run={last}", 404, _HEADERS)
        return None

    # Pages

    async def _page(self, request: Request) -> Response:
        """Return the page, or a part of it."""
        if refusal := self._refusal(request, 0):
            return refusal
        return self._assets.answer(request, request.path_params.get("name", _PAGE), _HEADERS)

    async def _rights(self, request: Request) -> Response:
        """Return the role of every browser here."""
        return self._refusal(request, 0) or PlainTextResponse(Role.LOOK, 200, _HEADERS)
