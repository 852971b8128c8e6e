"""HTTP and WebSocket side of the page: connections, and what each of them is sent."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

import msgspec
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from robotctl.config_values import Value
from robotctl.errors import RobotctlError
from robotctl.messages.control import ControlRequest, NavigationRequest
from robotctl.messages.mission import LoadMission
from robotctl.messages.recording import SetRecording
from robotctl.messages.tuning import ParameterRequest
from robotctl.web.access import HEADERS, Access, Asker, Role
from robotctl.web.assets import Assets
from robotctl.web.desk import LOOK_ONLY, Desk, Now, Save
from robotctl.web.outbox import Outbox
from robotctl.web.plan_uploads import (
    MAX_PLAN_BYTES,
    AnyUpload,
    BadPlan,
    Offered,
    PlanStore,
    mission_tree,
    offered,
    read_upload,
)
from robotctl.web.published import GivenMap, ParameterAnswer, Published, read, with_tag
from robotctl.web.rate import RateLimit
from robotctl.web.wire import (
    PROTOCOL,
    CameraPicture,
    ComputerState,
    Downward,
    Driver,
    Hello,
    LiveMessage,
    Refused,
    RobotOutline,
    Saved,
    StopMessage,
    encode,
    frame,
)

MAX_MESSAGE_BYTES: Final = 4096
"""Longest message from a page, and longest body of a POST."""
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
LINK_NEEDED: Final = "a token is needed: open the link that the robot prints, or `robotctl web`"
FRAME_BYTES: Final = 16_384
"""Size of a frame from which on nothing is added, so that a slow link is sent what is new."""
COMPUTER_NS: Final = 2_000_000_000
"""Period of the computer's figures [ns]."""
PICTURE_S: Final = 0.2
"""Shortest interval between two pictures of the camera [s]."""
_BODY_S: Final = 5.0
"""Time for the body of a POST [s]."""


class Session(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /session."""

    token: str


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


class PictureSource(Protocol):
    """The robot's camera, for who looks on."""

    def picture(self, view: bytes | None) -> CameraPicture | None:
        """Return the newest picture with the camera's newest published view; None: no new one.

        It takes some milliseconds, and is called by threads, one at a time.
        """

    def close(self) -> None:
        """Receive no more pictures until the next is asked for."""


@dataclass(slots=True)
class RobotSide:
    """The robot as the server reaches it.

    Parameters
    ----------
    outline
        What does not change.
    now
        The present by both clocks.
    to_control, to_navigation, to_telemetry, to_recorder
        Hand on a request; whether a process was there to take it.
    say
        Tell logs and ground stations.
    stores
        Keep plans over restarts, by their kind.
    camera
        Pictures of the camera; None: there is none.
    computer
        Figures of the computer, asked for in a thread, since a disk may hang; None: there are none.
    save
        Write parameters, by their keys, into the robot's file, in any thread; return the names of
        the file and of a copy of the old one, and the keys that are new. Raises `RobotctlError` or
        `OSError` where that cannot be.
    """

    outline: RobotOutline
    now: Callable[[], Now]
    to_control: Callable[[ControlRequest], bool]
    to_navigation: Callable[[NavigationRequest], bool]
    say: Callable[[str], None]
    to_telemetry: Callable[[ParameterRequest], bool]
    to_recorder: Callable[[SetRecording], bool]
    save: Callable[[Mapping[str, Value]], tuple[str, str, tuple[str, ...]]]
    stores: Mapping[str, PlanStore] = field(default_factory=dict)
    camera: PictureSource | None = None
    computer: Callable[[], ComputerState] | None = None


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
        self._assets = Assets(static)
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
        self._reading = asyncio.Lock()
        """Held while a plan is checked: one at a time, so that they leave time for all else."""
        self._saves: set[asyncio.Task[None]] = set()
        self._decode_live = msgspec.json.Decoder(LiveMessage).decode
        self._decode_stop = msgspec.json.Decoder(StopMessage).decode
        self._decode_session = msgspec.json.Decoder(Session).decode
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self._page),
                Route("/session", self._rights, methods=["GET"]),
                Route("/session", self._session, methods=["POST"]),
                Route("/assets/{name}", self._asset),
                Route("/plans", self._plan, methods=["POST"]),
                Route("/toml", self._toml, methods=["POST"]),
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
                begin_s = time.monotonic()
                view = self._latest.get("CameraView")
                picture = await asyncio.to_thread(camera.picture, view)
                if picture is not None:
                    data = encode(picture)
                    for connection in self._desk.watchers:
                        if isinstance(connection, Connection):
                            connection.put("CameraPicture", data, keep=False)
                            connection.woken.set()
                await asyncio.sleep(PICTURE_S - (time.monotonic() - begin_s))
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

    # Pages

    async def _page(self, request: Request) -> Response:
        """Return the page itself, which says nothing of the robot."""
        return self._file(request, "index.html")

    async def _asset(self, request: Request) -> Response:
        """Return a part of the page."""
        return self._file(request, request.path_params["name"])

    def _file(self, request: Request, name: str) -> Response:
        if objection := self._access.objection(asker_of(request), needs_origin=False):
            return PlainTextResponse(objection, 403, HEADERS)
        return self._assets.answer(request, name, HEADERS)

    async def _rights(self, request: Request) -> Response:
        """Return the role of a browser."""
        asker = asker_of(request)
        objection = self._access.objection(asker, needs_origin=False)
        role = self._access.role(asker)
        if objection or role is None:
            return PlainTextResponse(objection or LINK_NEEDED, 403, HEADERS)
        return PlainTextResponse(role, 200, HEADERS)

    async def _session(self, request: Request) -> Response:
        """Exchange a token for a cookie."""
        asker = asker_of(request)
        if objection := self._access.objection(asker, needs_origin=True):
            return PlainTextResponse(objection, 403, HEADERS)
        body = await _body(request, MAX_MESSAGE_BYTES)
        if isinstance(body, Response):
            return body
        try:
            token = self._decode_session(body).token
        except (msgspec.DecodeError, UnicodeError):
            return PlainTextResponse('{"token": "..."} is expected', 400, HEADERS)
        given = self._access.exchange(token)
        if given is None:
            return PlainTextResponse("this token is none of this robot", 403, HEADERS)
        response = PlainTextResponse(given[0], 200, HEADERS)
        response.set_cookie(
            self._access.cookie,
            given[1],
            max_age=30 * 86400,
            httponly=True,
            secure=request.url.scheme == "https",
            samesite="strict",
        )
        return response

    async def _plan(self, request: Request) -> Response:
        """Hand a mission, a fence or zones on to navigation, or say what is wrong with them."""
        body = await self._admitted(request, Role.DRIVE)
        if isinstance(body, Response):
            return body
        now = self._robot.now()
        try:
            async with self._reading:
                upload = await asyncio.to_thread(read_upload, body)
                if objection := self._desk.plan_objection(upload.client, upload.at_ms, now):
                    return PlainTextResponse(objection, 409, HEADERS)
                plan = await asyncio.to_thread(self._offered, upload, now)
        except BadPlan as error:
            return PlainTextResponse(str(error), 422, HEADERS)
        if plan.content and not plan.file:
            self._robot.say(f"the {plan.kind} cannot be saved, a restart will lose it")
        self._desk.offer(upload.client, upload.id, plan, self._robot.now())
        self._hand_on()
        return Response(msgspec.json.encode({"crc": plan.crc}), 200, HEADERS, "application/json")

    def _offered(self, upload: AnyUpload, now: Now) -> Offered:
        """Return a plan that is checked, and saved beside the one that the robot has."""
        plan = offered(upload, now.robot_ns)
        store = self._robot.stores.get(plan.kind)
        if store is None or not plan.content:
            return plan
        plan = plan._replace(file=store.save(plan.content))
        if isinstance(plan.request, LoadMission):
            plan = plan._replace(request=msgspec.structs.replace(plan.request, file=plan.file))
        return plan

    async def _toml(self, request: Request) -> Response:
        """Return a mission's file as the page edits it."""
        body = await self._admitted(request, Role.LOOK)
        if isinstance(body, Response):
            return body
        try:
            async with self._reading:
                tree = await asyncio.to_thread(mission_tree, body)
        except BadPlan as error:
            return PlainTextResponse(str(error), 422, HEADERS)
        return Response(msgspec.json.encode(tree), 200, HEADERS, "application/json")

    async def _admitted(self, request: Request, needed: Role) -> bytes | Response:
        """Return the body of a POST by a page that has a role; else the refusal."""
        asker = asker_of(request)
        objection = self._access.objection(asker, needs_origin=True)
        role = self._access.role(asker)
        if objection or role is None or (needed is Role.DRIVE and role is not Role.DRIVE):
            why = objection or (LINK_NEEDED if role is None else LOOK_ONLY)
            return PlainTextResponse(why, 403, HEADERS)
        return await _body(request, MAX_PLAN_BYTES)


async def _body(request: Request, most: int) -> bytes | Response:
    """Return the body of a POST; the refusal of one that is too long or too slow."""
    body = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for part in request.stream():
                body += part
                if len(body) > most:
                    return PlainTextResponse(f"too long: {most} bytes allowed", 413, HEADERS)
    except TimeoutError:
        return PlainTextResponse("too slow", 408, HEADERS)
    return body


def asker_of(connection: HTTPConnection) -> Asker:
    """Return where a request came to, and what it says of itself."""
    server = connection.scope.get("server") or ("", 0)
    headers = connection.headers
    return Asker(str(server[0]), headers.get("host"), headers.get("origin"), connection.cookies)


async def _close(socket: WebSocket, reason: str) -> None:
    """Close a socket with a reason of at most 123 bytes (RFC 6455, 5.5.1)."""
    short = reason.encode()[:120].decode(errors="ignore")
    try:
        await asyncio.wait_for(socket.close(_POLICY, short), 1.0)
    except (RuntimeError, WebSocketDisconnect, TimeoutError):
        return
