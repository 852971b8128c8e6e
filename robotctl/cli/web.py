"""`robotctl web`: where the web page of a running robot is, to click or to scan."""

from __future__ import annotations

import io
import time
from typing import TYPE_CHECKING, Annotated, Final

import typer

from robotctl.cli.driving import Instance
from robotctl.errors import LinkError

if TYPE_CHECKING:
    from robotctl.web.links import WebLinks

_WAIT_S: Final = 10.0
"""Time that a robot which has just started has to serve its page [s]."""


def web(
    instance: Instance = "",
    look: Annotated[
        bool, typer.Option("--look", help="The link with which one may only look.")
    ] = False,
) -> None:
    """Print the link to the web page of a robot that runs on this computer, as a QR code too."""
    from robotctl.app.supervision.running_robot import running  # noqa: PLC0415
    from robotctl.web.links import read_links  # noqa: PLC0415

    endpoints = running(instance)
    deadline_s = time.monotonic() + _WAIT_S
    while (links := read_links(endpoints.web_links)) is None:
        if time.monotonic() > deadline_s:
            raise LinkError(
                f"{endpoints.web_links}: not there, so this robot has no web page; start it with "
                "--web HOST:PORT, or with enabled = true under [web] in its file"
            )
        time.sleep(0.1)
    print(words(links, look=look), flush=True)


def words(links: WebLinks, *, look: bool = False) -> str:
    """Return a link, its QR code for phones where others can open it, and what to know of it."""
    link = links.look if look else links.drive
    lines = [f"web page: {link}", *(f"  {each}" for each in links.remarks)]
    if links.fingerprint:
        lines.append(f"  SHA-256 of its certificate: {links.fingerprint}")
    if links.is_remote:
        import segno  # noqa: PLC0415

        code = io.StringIO()
        segno.make(link, error="l").terminal(code, compact=True)
        lines.append(code.getvalue())
    return "\n".join(lines)
