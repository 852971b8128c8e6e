"""Messages between page and server of a replay, besides those of a robot.

Times are since the first message of a run, as the stamps of its messages are there [ns].
"""

from __future__ import annotations

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from robotctl.messages.control import Notice
from robotctl.web.wire import Downward, Ping, Upward


class Seek(Upward, frozen=True):
    """Show the run as it was at a time."""

    at_ns: Annotated[int, Meta(ge=0, le=2**53)]


class Play(Upward, frozen=True):
    """Go on from there, `rate` times as fast as it was."""

    rate: Annotated[float, Meta(gt=0.0, le=1000.0)]


class Pause(Upward, frozen=True):
    """Stand still."""


class Align(Upward, frozen=True):
    """Put the beginnings of two runs beside each other, or their first driving."""

    by_driving: bool


ReplayMessage: TypeAlias = Ping | Seek | Play | Pause | Align


class Playback(Downward, frozen=True):
    """The state of a replay; the messages of a picture come before it.

    `at_ns` is the time shown, of the client's run or, for a client of all runs, since the first of
    them began; `end_ns` is its last time. `topics` are the messages that there are at that time.
    `offsets_ns` say when each run begins, `by_driving` whether their first driving is at one time.
    """

    at_ns: int
    end_ns: int
    rate: float
    is_playing: bool
    topics: tuple[str, ...]
    offsets_ns: tuple[int, ...]
    by_driving: bool


class Stretch(msgspec.Struct, frozen=True):
    """The robot was in a state from `begin_ns` on, since `reason`."""

    begin_ns: int
    state: int
    reason: str


class History(msgspec.Struct, frozen=True):
    """A whole run at once.

    `times_s` (float64), `points` (x and y in `world` [m], float32) and `begins` (bool) are the path
    driven, which does not lead to a point that begins. `driving_ns` is when it first drove.
    `notes` say what is missing in it.
    """

    times_s: bytes
    points: bytes
    begins: bytes
    stretches: tuple[Stretch, ...]
    notices: tuple[Notice, ...]
    driving_ns: int | None
    end_ns: int
    notes: tuple[str, ...]


class Series(msgspec.Struct, frozen=True):
    """A field over a whole run: times [s] as float64, values as float32, nan where it has none."""

    field: str
    times_s: bytes
    values: bytes


FETCHED: Final = (History, Series)
"""Answers by HTTP."""
