"""HTTP and WebSocket side of the page: connections, and what each of them is sent."""

from __future__ import annotations

import asyncio
import itertools
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from robotctl.errors import RobotctlError
from robotctl.web.access import HEADERS, Access, Role
from robotctl.web.desk import Desk, Save
from robotctl.web.outbox import Outbox
from robotctl.web.pages import LINK_NEEDED, Pages, asker_of
from robotctl.web.published import GivenMap, ParameterAnswer, Published, read, with_tag
from robotctl.web.rate import RateLimit
from robotctl.web.robot_side import PictureSource, RobotSide
from robotctl.web.robot_view import Now
from robotctl.web.wire import (
    PROTOCOL,
    ComputerState,
    Downward,
    Driver,
    Hello,
    LiveMessage,
    Refused,
    Saved,
    StopMessage,
    encode,
    frame,
)

MAX_CLIENTS: Final = 16
"""Maximum connections of each kind and role: clients that may only look cannot use up those of
others."""
MESSAGES_PER_S, MESSAGES_AT_ONCE = 200, 60
"""Most messages of a page, which sends 21 a second: a network that stalls delivers some at once."""
IDLE_S, WATCHED_S, BUSY_S = 0.1, 0.04, 0.02
"""Period at which published messages are taken: without clients, with some, and while one of them
drives or waits for the answer to a stop [s]. Waking up costs more than all else."""
_NOTICES: Final = 50
"""Notices that a new client is told, the newest."""
_POLICY: Final = 1008
FRAME_BYTES: Final = 16_384
"""Size of a frame from which on nothing is added, so that a slow link is sent what is new."""
COMPUTER_NS: Final = 2_000_000_000
"""Period of the computer's figures [ns]."""
PICTURE_S: Final = 0.2
"""Shortest interval between two pictures of the camera [s]."""


@dataclass(eq=False, slots=True)
class Connection:
    """One socket: its client's role, what it is to be sent, and what wakes its sender."""

    role: Role
    outbox: Outbox = field(default_factory=Outbox)
    woken: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    end: str = ""
    """Why it is to be closed."""

    def close(self, why: str) -> None:
        """Let the connection end, also where its sender waits for a client that does not read."""
        self.end = why
        self.ended.set()

    def take(self, now_ns: int) -> list[bytes]:
        """Return what to send in one frame, and forget it: sending costs more than all else."""
        messages, size = [], 0
        while size < FRAME_BYTES and (data := self.outbox.next(now_ns)) is not None:
            messages.append(data)
            size += len(data)
        return messages

    def put(self, topic: str, data: bytes, *, keep: bool) -> None:
        """Add a message."""
        if keep:
            self.outbox.keep(topic, data)
            if self.outbox.is_hopeless:
                self.close("too far behind: this connection takes less than the robot must tell")
        else:
            self.outbox.show(topic, data)


class PageServer:
    """The application: pages, sockets, and the desk behind them.

    Parameters
    ----------
    robot
        The robot.
    desk
        Judges requests.
    access
        Who may do what.
    static
        Folder of the page.
    routes
        Pages of others beside it.
    """

    def __init__(
        self,
        robot: RobotSide,
        desk: Desk,
        access: Access,
        static: Path,
        routes: Sequence[BaseRoute] = (),
    ) -> None:
        self._robot = robot
        self._desk = desk
        self._access = access
        self._live: dict[int, Connection] = {}
        self._stops: set[Connection] = set()
        self._numbers = itertools.count(1)
        self._latest: dict[str, bytes] = {}
        """Newest message of each topic, for new clients."""
        self._told: dict[str, object] = {}
        self._notices: deque[bytes] = deque(maxlen=_NOTICES)
        self._given_map: msgspec.Raw | None = None
        self._driver = desk.driver
        self._computer_ns = 0
        """When the computer's figures are due [ns]."""
        self._reading_computer: asyncio.Task[None] | None = None
        self._filming: asyncio.Task[None] | None = None
        self._saves: set[asyncio.Task[None]] = set()
        self._decode_live = msgspec.json.Decoder(LiveMessage).decode
        self._decode_stop = msgspec.json.Decoder(StopMessage).decode
        self.app: ASGIApp = Starlette(
            routes=[
                *Pages(robot, desk, access, static, self._hand_on).routes,
                WebSocketRoute("/live", self._live_socket),
                WebSocketRoute("/stop", self._stop_socket),
                *routes,
            ]
        )

    # The robot's side

    @property
    def period_s(self) -> float:
        """Time until `relay` is to be called again [s]."""
        if self._desk.is_busy:
            return BUSY_S
        return WATCHED_S if self._live else IDLE_S

    def relay(self, messages: Iterable[bytes], truths: Iterable[bytes] = ()) -> None:
        """Take what the robot has published, and wake those who are to be sent something."""
        now = self._robot.now()
        for data in messages:
            message = read(data)
            if message is None:
                continue
            self._desk.hear(message, now)
            if not isinstance(message, ParameterAnswer):
                self._show(message, data)
        for data in list(truths)[-1:]:
            self._put("Truth", with_tag(data, "Truth"), keep=False)
        self._desk.step(now)
        self._hand_on()
        self._look_at_computer(now)
        if self._desk.watchers and self._filming is None and self._robot.camera is not None:
            self._filming = asyncio.create_task(self._film(self._robot.camera))
        for connection in self._live.values():
            connection.woken.set()

    def _look_at_computer(self, now: Now) -> None:
        """Let all clients see the computer's figures, if it is time."""
        is_read = self._reading_computer is None or self._reading_computer.done()
        read = self._robot.computer
        if read is not None and is_read and self._live and now.server_ns >= self._computer_ns:
            self._computer_ns = now.server_ns + COMPUTER_NS
            self._reading_computer = asyncio.create_task(self._tell_computer(read))

    async def _tell_computer(self, read: Callable[[], ComputerState]) -> None:
        """Read the computer's figures and send them."""
        self._put("ComputerState", encode(await asyncio.to_thread(read)), keep=False)

    def _show(self, message: Published, data: bytes) -> None:
        """Let all clients see a message."""
        topic = type(message).__name__
        if message.is_event:
            self._notices.append(data)
            self._put(topic, data, keep=True)
            return
        if isinstance(message, GivenMap):
            if message.map == self._given_map:
                return
            self._given_map = message.map.copy()
        told = message.told
        is_news = told != self._told.get(topic)
        if message.repeats and not is_news:
            return
        self._told[topic] = told
        self._latest[topic] = data
        self._put(topic, data, keep=is_news)

    async def _film(self, camera: PictureSource) -> None:
        """Send camera pictures to the pages that show them, until none does."""
        try:
            while self._desk.watchers:
                view = self._latest.get("CameraView")
                picture = await asyncio.to_thread(camera.picture, view)
                if picture is not None:
                    data = encode(picture)
                    for connection in self._desk.watchers:
                        if isinstance(connection, Connection):
                            connection.put("CameraPicture", data, keep=False)
                            connection.woken.set()
                await asyncio.sleep(PICTURE_S)
        finally:
            camera.close()
            self._filming = None

    def _put(self, topic: str, data: bytes, *, keep: bool) -> None:
        for connection in self._live.values():
            connection.put(topic, data, keep=keep)

    def _hand_on(self) -> None:
        """Send what the desk decided."""
        out = self._desk.take()
        for to_control in out.to_control:
            self._robot.to_control(to_control)
        for to_navigation in out.to_navigation:
            self._robot.to_navigation(to_navigation)
        for plan in out.taken:
            if (store := self._robot.stores.get(plan.kind)) is not None:
                asyncio.get_running_loop().run_in_executor(None, store.keep, plan.content)
        for to_telemetry in out.to_telemetry:
            self._robot.to_telemetry(to_telemetry)
        for save in out.saves:
            self._begin_save(save)
        for to_recorder in out.to_recorder:
            self._robot.to_recorder(to_recorder)
        for connection, message in out.answers:
            self._answer_to(connection, message)
        if self._desk.driver != self._driver:
            self._tell_driver(self._desk.driver)

    def _tell_driver(self, driver: Driver) -> None:
        """Let all clients, logs and ground stations know who drives now."""
        if driver.client != self._driver.client:
            self._robot.say(f"{driver.name} drives" if driver.name else driver.why)
        self._driver = driver
        for each in self._live.values():
            self._answer(each, driver)

    def _begin_save(self, save: Save) -> None:
        """Write the robot's file, one at a time."""
        if self._saves:
            self._answer_to(save.connection, Refused(save.number, "the file is being written"))
            return
        task = asyncio.get_running_loop().create_task(self._save(save))
        self._saves.add(task)
        task.add_done_callback(self._saves.discard)

    async def _save(self, save: Save) -> None:
        """Write parameters into the robot's file; a stop must not wait for the disk."""
        try:
            written = await asyncio.to_thread(self._robot.save, save.values)
        except (RobotctlError, OSError) as error:
            answer: Downward = Refused(save.number, str(error))
        else:
            file, copy, keys = written
            answer = Saved(save.number, file, copy, keys)
        self._answer_to(save.connection, answer)

    def _answer_to(self, connection: object, message: Downward) -> None:
        if isinstance(connection, Connection):
            self._answer(connection, message)

    def _answer(self, connection: Connection, message: Downward | Hello) -> None:
        connection.put(type(message).__name__, encode(message), keep=True)
        connection.woken.set()

    # Sockets

    async def _live_socket(self, socket: WebSocket) -> None:
        """Serve one page."""
        role = await self._admit(socket, self._live.values())
        if role is None:
            return
        client, connection = next(self._numbers), Connection(role)
        may_drive = role is Role.DRIVE
        self._live[client] = connection
        self._desk.join(client, connection, may_drive=may_drive)
        if may_drive:
            address = socket.client.host if socket.client else "?"
            self._desk.name(client, f"client {client} ({address})")
        self._greet(connection, client, role)
        limit = RateLimit(MESSAGES_PER_S, MESSAGES_AT_ONCE)

        def take(text: str, now: Now) -> None:
            self._desk.take_message(client, self._decode_live(text), now)

        try:
            await self._serve(socket, connection, take, limit)
        finally:
            del self._live[client]
            self._desk.leave(client, self._robot.now())
            self._hand_on()

    async def _stop_socket(self, socket: WebSocket) -> None:
        """Serve one connection for stops."""
        role = await self._admit(socket, self._stops)
        if role is None:
            return
        connection = Connection(role)
        self._stops.add(connection)
        limit = RateLimit(MESSAGES_PER_S, MESSAGES_AT_ONCE)

        def take(text: str, now: Now) -> None:
            self._desk.stop(connection, self._decode_stop(text), now)

        try:
            await self._serve(socket, connection, take, limit)
        finally:
            self._stops.discard(connection)

    async def _admit(self, socket: WebSocket, others: Iterable[Connection]) -> Role | None:
        """Accept a socket and return its role; None: it is refused."""
        asker = asker_of(socket)
        objection = self._access.objection(asker, needs_origin=True)
        role = self._access.role(asker)
        if objection or role is None:
            await socket.send_denial_response(
                PlainTextResponse(objection or LINK_NEEDED, 403, HEADERS)
            )
            return None
        await socket.accept()
        if sum(each.role is role for each in others) >= MAX_CLIENTS:
            await socket.close(_POLICY, f"{MAX_CLIENTS} clients are connected, no more allowed")
            return None
        return role

    def _greet(self, connection: Connection, client: int, role: Role) -> None:
        """Tell a new client who it is, and all that is known."""
        now = self._robot.now()
        outline = msgspec.structs.asdict(self._robot.outline)
        hello = Hello(
            **outline,
            protocol=PROTOCOL,
            client=client,
            role=role,
            server_ns=now.server_ns,
            robot_ns=now.robot_ns,
        )
        self._answer(connection, hello)
        self._answer(connection, self._desk.driver)
        for notice in self._notices:
            connection.put("Notice", notice, keep=True)
        for topic, data in self._latest.items():
            connection.put(topic, data, keep=False)

    async def _serve(
        self,
        socket: WebSocket,
        connection: Connection,
        take: Callable[[str, Now], None],
        limit: RateLimit,
    ) -> None:
        """Receive and send until the connection ends."""
        sender: asyncio.Task[object] = asyncio.create_task(self._send(socket, connection))
        receiver = asyncio.create_task(self._receive(socket, connection, take, limit))
        tasks = {sender, receiver, asyncio.create_task(connection.ended.wait())}
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        if connection.end:
            await _close(socket, connection.end)

    async def _receive(
        self,
        socket: WebSocket,
        connection: Connection,
        take: Callable[[str, Now], None],
        limit: RateLimit,
    ) -> None:
        """Take messages until the connection ends, or one of them is none."""
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            now = self._robot.now()
            if not limit.allows(now.server_ns):
                connection.close(f"too fast: at most {MESSAGES_PER_S} messages a second")
                return
            try:
                take(message.get("text") or "", now)
            except (msgspec.DecodeError, UnicodeError, OverflowError) as error:
                connection.close(f"no such message: {error}")
                return
            self._hand_on()

    async def _send(self, socket: WebSocket, connection: Connection) -> None:
        """Send waiting messages; a client that does not read delays no other."""
        while True:
            messages = connection.take(self._robot.now().server_ns)
            if not messages:
                connection.woken.clear()
                await connection.woken.wait()
                continue
            try:
                await socket.send_bytes(frame(messages))
            except (WebSocketDisconnect, RuntimeError):
                return


async def _close(socket: WebSocket, reason: str) -> None:
    """Close a socket with a reason of at most 123 bytes (RFC 6455, 5.5.1)."""
    short = reason.encode()[:120].decode(errors="ignore")
    try:
        await asyncio.wait_for(socket.close(_POLICY, short), 1.0)
    except (RuntimeError, WebSocketDisconnect, TimeoutError):
        return
