"""Message signing: who has the key may talk to the robot, and no frame counts twice.

https://mavlink.io/en/guide/message_signing.html. The signature is checked before anything of a
frame counts, so frames of others change nothing here. Time stamps of signed frames must rise for
each sender and link, whichever way they come: one table for the whole vehicle, of bounded size,
which outlives a restart. A sender that was not heard since must not be more than a minute late.

That page lets the robot's time follow the newest stamp of all, so one station whose clock is years
ahead would keep out all others. Here a robot that has a clock goes by that; one whose clock shows a
year before `RELEASED` has none, and follows. Who is late is told the time by a signed message, and
follows by its own rules; answers to who is ahead are stamped after its own stamps.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import common

from robotctl.messages.mavlink_port import Address

KEY_SIZE: Final = 32
SIGNED: Final[int] = common.MAVLINK_IFLAG_SIGNED
_SIGNATURE: Final = 6
_STAMP: Final = slice(-12, -6)
_LINK: Final = -13
_EPOCH_NS: Final = 1_420_070_400_000_000_000
"""2015-01-01 00:00 UTC, from which time stamps count [ns]."""
_UNIT_NS: Final = 10_000
MINUTE: Final = 6_000_000
"""A minute in units of time stamps."""
LATEST: Final = 2**47
"""Maximum time stamp, in the year 2059: after a later one, a mistake, none would be newer."""
RELEASED: Final = 283_996_800 * 100_000
"""Minimum time stamp of a clock that is set, in the year 2024."""
MOST_STREAMS: Final = 64
"""Senders that are remembered one by one."""

Stream: TypeAlias = tuple[int, int, int]
"""System, component, and link of a sender."""


class SignatureVerdict(NamedTuple):
    """Whether a frame is taken.

    `stamp` is its time stamp, or of one that is too late that which had to be exceeded; 0 for one
    that is not of who has the key.
    """

    taken: bool
    stamp: int


class Memory(NamedTuple):
    """State kept over a restart: the last time stamp of each sender, and of those forgotten."""

    floor: int = 0
    last: tuple[tuple[Stream, int], ...] = ()


class Signing:
    """The key, the clock of signatures, and the last time stamp of each sender.

    Parameters
    ----------
    key
        32 bytes; None: frames are neither signed nor checked.
    stamp
        Time stamps go on from here, should the clock be behind: a minute after that of before the
        restart.
    wall_ns
        Returns the time since 1970 [ns].
    memory
        What was kept before the restart.

    Attributes
    ----------
    refused
        Frames that were not taken since the start.
    """

    def __init__(
        self,
        key: bytes | None = None,
        stamp: int = 0,
        wall_ns: Callable[[], int] = time.time_ns,
        memory: Memory = Memory(),  # noqa: B008 - it does not change
    ) -> None:
        self.key = key
        self.refused = 0
        self._wall_ns = wall_ns
        self._stamp = stamp
        """The newest of the robot's own."""
        self._seen = max(stamp - MINUTE, 0)
        """The time of a robot without a clock."""
        self._last = dict(memory.last)
        self._floor = memory.floor
        self._heard: set[Stream] = set()
        """Senders heard since the start."""
        self._ahead: dict[Stream, int] = {}
        """Leads of the clocks of senders, not told yet [time stamps]."""

    @property
    def stamp(self) -> int:
        """The newest time stamp that was used, or is the robot's time."""
        return max(self._stamp, self._seen)

    @property
    def memory(self) -> Memory:
        """State to keep over a restart."""
        return Memory(self._floor, tuple(self._last.items()))

    @property
    def wall_us(self) -> int:
        """The time since 1970 [us]."""
        return self._wall_ns() // 1000

    def next_stamp(self) -> int:
        """Return the time stamp of the next frame: that of the clock, but always a new one."""
        self._stamp = min(max(self._stamp + 1, self._seen + 1, self._wall()), LATEST)
        return self._stamp

    def judge(self, frame: bytes | bytearray, sender: Address) -> SignatureVerdict:
        """Say whether a whole frame, whose checksum is right, is of who has the key, and new."""
        if self.key is None:
            return SignatureVerdict(taken=True, stamp=0)
        stamp = int.from_bytes(frame[_STAMP], "little")
        verdict = SignatureVerdict(taken=False, stamp=0)
        if _is_signed(frame) and stamp < LATEST and self._is_right(frame):
            verdict = self._judge_time((*sender, frame[_LINK]), stamp)
        self.refused += not verdict.taken
        return verdict

    def take_key(self, key: bytes, stamp: int) -> None:
        """Use another key from now on; time stamps begin at `stamp`, or go on."""
        self.key = key
        self._stamp = max(self._stamp, min(stamp, LATEST))
        self._last.clear()
        self._heard.clear()
        self._floor = 0

    def take_ahead(self) -> dict[Stream, int]:
        """Return once by how much the clock of each sender is ahead of the robot's, if it is.

        In units of time stamps; from a minute on, where the robot has a clock.
        """
        ahead, self._ahead = self._ahead, {}
        return ahead

    def _is_right(self, frame: bytes | bytearray) -> bool:
        """Say whether the signature is that of the key."""
        digest = hashlib.sha256((self.key or b"") + frame[:-_SIGNATURE]).digest()
        return hmac.compare_digest(digest[:_SIGNATURE], bytes(frame[-_SIGNATURE:]))

    def _judge_time(self, stream: Stream, stamp: int) -> SignatureVerdict:
        """Say whether a time stamp is newer than all of its sender; remember it then."""
        least = self._last.get(stream, self._floor) + 1
        if stream not in self._heard:
            now = self._now()
            least = max(least, now - MINUTE)
            if self._has_clock and stamp > now + MINUTE:
                self._ahead[stream] = stamp - now
        if stamp < least:
            return SignatureVerdict(taken=False, stamp=least)
        self._heard.add(stream)
        self._last[stream] = stamp
        if len(self._last) > MOST_STREAMS:  # the one whose time stamps are oldest
            gone = min(self._last, key=self._last.__getitem__)
            self._floor = max(self._floor, self._last.pop(gone))
            self._heard.discard(gone)
        if not self._has_clock:
            self._seen = max(self._seen, stamp)
        return SignatureVerdict(taken=True, stamp=stamp)

    @property
    def _has_clock(self) -> bool:
        return self._wall() >= RELEASED

    def _wall(self) -> int:
        """Return the time stamp of the clock."""
        return (self._wall_ns() - _EPOCH_NS) // _UNIT_NS

    def _now(self) -> int:
        """Return the time stamp of now."""
        return self._wall() if self._has_clock else self._seen


def _is_signed(frame: bytes | bytearray) -> bool:
    return frame[0] == common.PROTOCOL_MARKER_V2 and bool(frame[2] & SIGNED)
