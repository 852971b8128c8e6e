"""Pages, the session, and uploads of plans: what the server answers by HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from robotctl.messages.mission import LoadMission
from robotctl.web.access import HEADERS, Access, Asker, Role
from robotctl.web.assets import Assets
from robotctl.web.desk import LOOK_ONLY, Desk
from robotctl.web.plan_uploads import (
    MAX_PLAN_BYTES,
    AnyUpload,
    BadPlan,
    Offered,
    mission_tree,
    offered,
    read_upload,
)
from robotctl.web.robot_side import RobotSide
from robotctl.web.robot_view import Now

MAX_MESSAGE_BYTES: Final = 4096
"""Longest message from a page, and longest body of a POST."""
LINK_NEEDED: Final = "a token is needed: open the link that the robot prints, or `robotctl web`"
_BODY_S: Final = 5.0
"""Time for the body of a POST [s]."""


class PageSession(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /session."""

    token: str


class Pages:
    """Answers requests.

    Parameters
    ----------
    robot, desk, access
        As of `PageServer`.
    static
        Folder of the page.
    hand_on
        Sends what the desk has decided.

    Attributes
    ----------
    routes
        Routes of the application.
    """

    def __init__(
        self,
        robot: RobotSide,
        desk: Desk,
        access: Access,
        static: Path,
        hand_on: Callable[[], None],
    ) -> None:
        self._robot = robot
        self._desk = desk
        self._access = access
        self._assets = Assets(static)
        self._hand_on = hand_on
        self._reading = asyncio.Lock()
        """Held while a plan is checked: one at a time, so that they leave time for all else."""
        self._decode_session = msgspec.json.Decoder(PageSession).decode
        self.routes = [
            Route("/", self._page),
            Route("/session", self._rights, methods=["GET"]),
            Route("/session", self._session, methods=["POST"]),
            Route("/assets/{name}", self._asset),
            Route("/plans", self._plan, methods=["POST"]),
            Route("/toml", self._toml, methods=["POST"]),
        ]

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
