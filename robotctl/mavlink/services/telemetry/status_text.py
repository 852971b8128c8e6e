"""STATUSTEXT: lines for people, long ones in chunks."""

from __future__ import annotations

from collections.abc import Iterator

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context, Text
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import Message

CHUNK = 50
MAX_LENGTH = 1000
TEXTS_PER_STEP = 4
"""A burst of notices is spread, so that it does not crowd out answers on slow links."""

MAX_UNSENT = 16
"""Texts kept for a ground station."""


class StatusText(Microservice):
    """Sends the texts that other services and processes left in the context.

    The last warnings, and worse, that were sent while no ground station was there are sent again,
    each with its age, when one comes: why a robot stands was often said before.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._unsent: dict[str, tuple[int, int]] = {}
        self._last_id = 0

    def step(self, now_ns: int) -> None:
        """Send a few of the waiting texts."""
        heard, links = bool(self._context.ground_stations), self._context.links
        for severity, text, peer in self._next(now_ns, heard=heard):
            self._last_id = self._last_id % 0xFFFF + 1
            for message in status_texts(severity, text, self._last_id):
                links.broadcast(message) if peer is None else links.reply(message, peer)

    def _next(self, now_ns: int, *, heard: bool) -> Iterator[Text]:
        """Yield the texts of this step, unreceived ones first."""
        texts = self._context.texts
        for _ in range(TEXTS_PER_STEP):
            if heard and self._unsent:
                line = next(iter(self._unsent))
                severity, said_ns = self._unsent.pop(line)
                yield Text(severity, f"{line} ({(now_ns - said_ns) / 1e9:.0f} s ago)")
            elif texts:
                text = texts.popleft()
                if not heard and text.severity <= Severity.WARNING and text.peer is None:
                    self._keep(text.severity, text.line, now_ns)
                yield text

    def _keep(self, severity: int, text: str, now_ns: int) -> None:
        """Keep a text for a ground station, once, so that repeated ones leave room."""
        self._unsent.pop(text, None)
        self._unsent[text] = (severity, now_ns)
        if len(self._unsent) > MAX_UNSENT:
            del self._unsent[next(iter(self._unsent))]


def status_texts(severity: int, text: str, identifier: int) -> Iterator[Message]:
    """Yield the messages of one text.

    Parameters
    ----------
    severity : int
        RFC 5424 number, the same as MAV_SEVERITY; forced into 0 to 7.
    text : str
        Characters beyond ASCII become question marks; cut after 1000 characters.
    identifier : int
        1 to 65535, common to the chunks of a text longer than 50 characters.
    """
    severity = max(0, min(severity, 7))
    data = text[:MAX_LENGTH].encode("ascii", "replace").replace(b"\0", b" ")
    if len(data) <= CHUNK:
        yield common.MAVLink_statustext_message(severity, data)
        return
    # A chunk of less than 50 characters ends the text, if need be an empty one.
    for number in range(len(data) // CHUNK + 1):
        chunk = data[number * CHUNK : (number + 1) * CHUNK]
        yield common.MAVLink_statustext_message(severity, chunk, identifier, number)
