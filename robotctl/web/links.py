"""Links to the page of a running robot, in a private file of its web process."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec


class WebLinks(msgspec.Struct, frozen=True):
    """Links of a page.

    Attributes
    ----------
    drive, look
        Links for those who may drive and for those who may only look, tokens included.
    port
        Port of the server.
    is_remote
        Whether other computers reach it.
    fingerprint
        SHA-256 of the certificate; empty: there is none.
    remarks
        Sentences for people: a port that was taken, a connection that is not encrypted.
    """

    drive: str
    look: str
    port: int
    is_remote: bool = False
    fingerprint: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def address(self) -> str:
        """Link without a token, for what may end in a log."""
        return self.drive.partition("#")[0]


def write_links(path: Path, links: WebLinks) -> None:
    """Write the links for this user alone."""
    write_private(path, msgspec.json.encode(links))


def read_links(path: Path) -> WebLinks | None:
    """Return the links; None: there is no page yet."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=WebLinks)
    except (OSError, msgspec.DecodeError):
        return None


def write_private(path: Path, data: bytes) -> None:
    """Write a file that only this user can read, as a whole or not at all."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.unlink(missing_ok=True)
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(descriptor, "wb") as file:  # noqa: PTH123 - a descriptor, for its mode
        file.write(data)
    part.replace(path)
