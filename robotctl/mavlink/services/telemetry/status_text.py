"""STATUSTEXT: lines for people, long ones in chunks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context, Said
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import Message, Peer
from robotctl.safety.state_machine import LATCHED

CHUNK = 50
MAX_LENGTH = 1000
TEXTS_PER_STEP = 4
"""Maximum texts of a step: a burst is spread, so that it does not crowd out answers on slow
links."""

MAX_UNSENT = 16
"""Texts kept for a ground station."""

LATE_NS: Final = 1_000_000_000
"""Age from which on a line is sent with its age [ns]."""

_WHOLE_S: Final = 9.95
"""Age from which on tenths of a second are left out [s]."""


class StatusText(Microservice):
    """Sends the texts that other services and processes left in the context.

    The last warnings, and worse, that were sent while no ground station was there are sent again
    when one comes. Why the robot stands is also said whenever this process starts or a station
    comes: it may have stopped while nobody could be told. What was said a while ago has its age.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._unsent: dict[str, Said] = {}
        self._last_id = 0
        self._told: set[tuple[int, int]] | None = None
        """The ground stations that know why the robot stands; None: control was not heard yet."""

    def step(self, now_ns: int) -> None:
        """Send a few of the waiting texts."""
        self._explain(now_ns)
        heard, links = bool(self._context.ground_stations), self._context.links
        for severity, text, peer in self._next(now_ns, heard=heard):
            self._last_id = self._last_id % 0xFFFF + 1
            for message in status_texts(severity, text, self._last_id):
                links.broadcast(message) if peer is None else links.reply(message, peer)

    def _explain(self, now_ns: int) -> None:
        """Say why the robot stands, at the start and to each ground station that comes."""
        context = self._context
        control = context.fresh_control(now_ns)
        if control is None:
            return
        told, self._told = self._told, set(context.ground_stations)
        if told is not None and self._told <= told:
            return
        navigation = context.fresh_navigation(now_ns)
        if control.state in LATCHED and control.stopped_ns:
            text = f"stopped: {control.reason}"
            self._repeat(Said(Severity.CRITICAL, text, control.stopped_ns))
        elif navigation is not None and navigation.held:
            self._repeat(Said(Severity.WARNING, navigation.message, navigation.stamp_ns))

    def _repeat(self, said: Said) -> None:
        """Say something once more, unless it waits to be said."""
        waiting = {each.text for each in self._context.texts} | self._unsent.keys()
        if said.text not in waiting:
            self._context.texts.append(said)

    def _next(self, now_ns: int, *, heard: bool) -> Iterator[tuple[int, str, Peer | None]]:
        """Yield the texts of this step, unreceived ones first."""
        texts = self._context.texts
        for _ in range(TEXTS_PER_STEP):
            if heard and self._unsent:
                said = self._unsent.pop(next(iter(self._unsent)))
                yield said.severity, f"{said.text} ({_ago(said, now_ns)})", None
            elif texts:
                said = texts.popleft()
                if not heard and said.severity <= Severity.WARNING and said.peer is None:
                    self._keep(said)
                late = now_ns - said.stamp_ns > LATE_NS
                text = f"{said.text} ({_ago(said, now_ns)})" if late else said.text
                yield said.severity, text, said.peer

    def _keep(self, said: Said) -> None:
        """Keep a text for a ground station, once, so that repeated ones leave room."""
        self._unsent.pop(said.text, None)
        self._unsent[said.text] = said
        if len(self._unsent) > MAX_UNSENT:
            del self._unsent[next(iter(self._unsent))]


def _ago(said: Said, now_ns: int) -> str:
    """Return how long ago something was said."""
    age_s = max(0, now_ns - said.stamp_ns) / 1e9
    return f"{age_s:.0f} s ago" if age_s >= _WHOLE_S else f"{age_s:.1f} s ago"


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
