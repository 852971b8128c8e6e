"""Recordings of a robot: their list, and their files one by one.

Whoever may look may have them, since they hold no more than the page shows. A name is one of the
list or none: no path is made of what a browser sends.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Sequence
from typing import Final, Protocol

import msgspec
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route
from starlette.types import Receive, Scope, Send

from robotctl.web.access import HEADERS, Access
from robotctl.web.pages import LINK_NEEDED, asker_of

_PART_BYTES: Final = 256 * 1024


class RecordedFile(msgspec.Struct, frozen=True):
    """File of a recording: size [B] and times since 1970 [s]; None: it has no times.

    `is_written`: it is being written now.
    """

    name: str
    size: int
    modified_s: float
    begin_s: float | None
    end_s: float | None
    is_written: bool


class RecordingList(msgspec.Struct, frozen=True):
    """Files of the recordings, the newest first."""

    files: tuple[RecordedFile, ...]


class RecordingSource(Protocol):
    """Folder of recordings; both methods wait for the disk and are called in a thread."""

    def list(self) -> Sequence[RecordedFile]:
        """Return the files, the newest first; raises OSError."""
        ...

    def open(self, name: str) -> int:
        """Return a descriptor of a file of the list; raises OSError."""
        ...


class RecordingPages:
    """Answers to requests for recordings.

    Parameters
    ----------
    source
        The folder; None: the robot records nothing.
    access
        Who may have them.
    """

    def __init__(self, source: RecordingSource | None, access: Access) -> None:
        self._source = source
        self._access = access
        self.routes: list[BaseRoute] = [
            Route("/recordings", self._list),
            Route("/recordings/{name}", self._file),
        ]

    async def _list(self, request: Request) -> Response:
        """Return the list."""
        if refusal := self._refusal(request):
            return refusal
        try:
            files = await asyncio.to_thread(self._source.list) if self._source else ()
        except OSError as error:
            return PlainTextResponse(_words(error), 503, HEADERS)
        return Response(
            msgspec.msgpack.encode(RecordingList(tuple(files))), 200, HEADERS, "application/msgpack"
        )

    async def _file(self, request: Request) -> Response:
        """Return one file, part by part."""
        name = request.path_params["name"]
        if refusal := self._refusal(request):
            return refusal
        if self._source is None:
            return PlainTextResponse("no such recording", 404, HEADERS)
        try:
            descriptor = await asyncio.to_thread(self._source.open, name)
        except FileNotFoundError:
            return PlainTextResponse("no such recording", 404, HEADERS)
        except OSError as error:
            return PlainTextResponse(_words(error), 503, HEADERS)
        size = os.fstat(descriptor).st_size
        headers = {
            **HEADERS,
            "Content-Length": str(size),
            "Content-Disposition": f'attachment; filename="{name}"',
        }
        return _FileResponse(descriptor, size, headers)

    def _refusal(self, request: Request) -> Response | None:
        """Return why a request is not answered; None: it is."""
        asker = asker_of(request)
        objection = self._access.objection(asker, needs_origin=False)
        if objection or self._access.role(asker) is None:
            return PlainTextResponse(objection or LINK_NEEDED, 403, HEADERS)
        return None


class _FileResponse(StreamingResponse):
    """As much of an open file as there is now; a file that grows meanwhile is cut there."""

    def __init__(self, descriptor: int, size: int, headers: dict[str, str]) -> None:
        self._descriptor = descriptor
        super().__init__(self._parts(size), headers=headers, media_type="application/octet-stream")

    async def _parts(self, size: int) -> AsyncIterator[bytes]:
        at = 0
        while at < size:
            wanted = min(_PART_BYTES, size - at)
            part = await asyncio.to_thread(os.pread, self._descriptor, wanted, at)
            if not part:
                return
            at += len(part)
            yield part

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it, and close the file whatever happens."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            os.close(self._descriptor)


def _words(error: OSError) -> str:
    """Return what the disk says."""
    return f"{error.filename or 'the disk'}: {error.strerror or error}"
