"""Says which link is out of order, and when it works again."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import LinkStatus

PATIENCE_NS = 1_000_000_000
"""Maximum drop-out of a link that is not reported [ns]."""


@dataclass
class _Seen:
    """Known state of one link: times it opened, since when it fails, whether that was reported."""

    opened: int = 0
    failing_ns: int | None = None
    told: bool = False


class LinkWatch(Microservice):
    """Reports once each link that cannot be opened, and once that it is open again.

    The robot needs no particular link: the others work on, and the failed one is tried again.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._seen = [_Seen() for _ in range(context.links.count)]

    def step(self, now_ns: int) -> None:
        """Look at the counters of all links."""
        for status, seen in zip(self._context.links.status(), self._seen, strict=False):
            self._look(status, seen, now_ns)

    def _look(self, status: LinkStatus, seen: _Seen, now_ns: int) -> None:
        """Compare one link with its last known state."""
        if status.opened != seen.opened:
            seen.opened, seen.failing_ns = status.opened, None
            if seen.told:
                seen.told = False
                self._context.say(now_ns, f"MAVLink {status.url} is open", Severity.INFORMATION)
        if seen.failing_ns is None:
            if status.errors and not status.open:
                seen.failing_ns = now_ns
        elif not seen.told and now_ns - seen.failing_ns >= PATIENCE_NS:
            seen.told = True
            text = f"MAVLink {status.url} is closed, retrying: {status.last_error}"
            self._context.say(now_ns, text)
