"""Files of the page, as they are served."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

_KINDS: Final = {
    ".css": "text/css",
    ".html": "text/html",
    ".ico": "image/vnd.microsoft.icon",
    ".js": "text/javascript",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".webmanifest": "application/manifest+json",
    ".woff2": "font/woff2",
}


class _Asset(NamedTuple):
    """Part of the page."""

    content: bytes
    kind: str
    tag: str

    @classmethod
    def of(cls, name: str, content: bytes) -> _Asset:
        """Return content with its kind and what tells whether it changed."""
        tag = f'"{hashlib.sha256(content).hexdigest()[:16]}"'
        return cls(content, _KINDS[Path(name).suffix], tag)


class Assets:
    """Files of a folder, read once.

    Parameters
    ----------
    folder
        The folder; what is no part of a page is passed over.
    changed
        Content in place of that of some files, by name.
    """

    def __init__(self, folder: Path, changed: Mapping[str, bytes] | None = None) -> None:
        there = [each for each in folder.iterdir() if each.is_file() and each.suffix in _KINDS]
        contents = {each.name: each.read_bytes() for each in there} | dict(changed or {})
        self._files = {name: _Asset.of(name, content) for name, content in contents.items()}

    def answer(self, request: Request, name: str, headers: Mapping[str, str]) -> Response:
        """Return the answer to a request for a file."""
        file = self._files.get(name)
        if file is None:
            return PlainTextResponse("no such page", 404, headers)
        if request.headers.get("if-none-match") == file.tag:
            return Response(b"", 304, {**headers, "ETag": file.tag})
        return Response(file.content, 200, {**headers, "ETag": file.tag}, file.kind)
