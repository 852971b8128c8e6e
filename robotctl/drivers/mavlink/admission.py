"""Admission of peers when a server is full: operators first, then those that stay in touch.

A server serves `MAX_PEERS`. Where all places are taken, whoever sends a heartbeat gets that of a
peer that

- has sent heartbeats for less than `ESTABLISHED_NS`: programs that come and go keep nobody out, or
- has been silent for `QUIET_NS`, three heartbeats; a ground station only for another one, or
- is no ground station, where the newcomer is one.

So a flood of senders that each say one heartbeat never costs an operator the place, and an operator
who comes to a server full of other programs gets one.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from pymavlink.dialects.v20 import common

from robotctl.messages.mavlink_port import Message

MAX_PEERS: Final = 8
SILENT_NS: Final = 10_000_000_000
"""Silence after which a server drops a peer [ns]; ground stations send every second."""
QUIET_NS: Final = 3_000_000_000
ESTABLISHED_NS: Final = 2_000_000_000
"""Silence, and time in touch, that decide on precedence [ns]: see above."""

_HEARTBEAT: Final = common.MAVLINK_MSG_ID_HEARTBEAT
_Key = TypeVar("_Key", bound=Hashable)


@dataclass(slots=True)
class Standing:
    """Standing of a peer; times are monotonic [ns], None: never."""

    heard_ns: int | None = None
    first_beat_ns: int | None = None
    beat_ns: int | None = None
    is_operator: bool = False
    """Whether it has sent the heartbeat of a ground station."""

    def hear(self, messages: Sequence[Message], now_ns: int) -> None:
        """Take what the peer sends."""
        for message in messages:
            self.heard_ns = now_ns
            if message.get_msgId() == _HEARTBEAT:
                self.first_beat_ns = now_ns if self.first_beat_ns is None else self.first_beat_ns
                self.beat_ns = now_ns
                self.is_operator |= message.type == common.MAV_TYPE_GCS

    @property
    def is_established(self) -> bool:
        """Whether it has sent heartbeats for a while."""
        first, last = self.first_beat_ns, self.beat_ns
        return first is not None and last is not None and last - first >= ESTABLISHED_NS

    def silent_ns(self, now_ns: int) -> int:
        """Return for how long it has been silent [ns]."""
        return now_ns - (self.heard_ns or 0)


def displaced(newcomer: Standing, served: Mapping[_Key, Standing], now_ns: int) -> _Key | None:
    """Return whose place a newcomer takes that has just sent something; None: it has to wait."""
    if newcomer.beat_ns != now_ns:
        return None
    weak = [key for key, peer in served.items() if _yields(peer, newcomer, now_ns)]

    def worth(key: _Key) -> tuple[bool, bool, int]:
        peer = served[key]
        return peer.is_operator, peer.is_established, -peer.silent_ns(now_ns)

    return min(weak, key=worth, default=None)


def _yields(peer: Standing, newcomer: Standing, now_ns: int) -> bool:
    """Say whether a newcomer has precedence over a peer."""
    if not peer.is_established:
        return True
    if newcomer.is_operator and not peer.is_operator:
        return True
    is_quiet = peer.silent_ns(now_ns) > QUIET_NS
    return is_quiet and newcomer.is_operator >= peer.is_operator
