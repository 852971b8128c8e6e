"""Message signing: who has the key may talk to the robot, and no frame counts twice.

https://mavlink.io/en/guide/message_signing.html. The signature is checked before anything of a
frame counts, so frames of others change nothing here. Time stamps of signed frames must rise for
each sender and link, whichever way they come: one table for the whole vehicle, of bounded size.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import common

KEY_SIZE: Final = 32
SIGNED: Final[int] = common.MAVLINK_IFLAG_SIGNED
_SIGNATURE: Final = 6
_STAMP: Final = slice(-12, -6)
_LINK: Final = -13
_EPOCH_NS: Final = 1_420_070_400_000_000_000
"""2015-01-01 00:00 UTC, from which time stamps count [ns]."""
_UNIT_NS: Final = 10_000
MINUTE: Final = 6_000_000
"""In units of time stamps."""
LAST: Final = 2**48 - 1
MOST_STREAMS: Final = 64
"""Senders that are remembered one by one."""

_Stream = tuple[int, int, int]


class Signing:
    """The key, the clock of signatures, and the last time stamp of each sender.

    Parameters
    ----------
    key
        32 bytes; None: frames are neither signed nor checked.
    stamp
        Time stamps go on from here, should the clock be behind: that of before the restart.
    wall_ns
        Returns the time since 1970 [ns].

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
    ) -> None:
        self.key = key
        self.refused = 0
        self._wall_ns = wall_ns
        self._stamp = stamp
        self._last: dict[_Stream, int] = {}
        """The last time stamp of each sender, the longest silent first."""
        self._floor = 0
        """The newest time stamp of a sender that is forgotten."""

    @property
    def stamp(self) -> int:
        """The newest time stamp used or seen."""
        return self._stamp

    def next_stamp(self) -> int:
        """Return the time stamp of the next frame: that of the clock, but always a new one."""
        now = (self._wall_ns() - _EPOCH_NS) // _UNIT_NS
        self._stamp = min(max(self._stamp + 1, now), LAST)
        return self._stamp

    def accepts(self, frame: bytes | bytearray, sender: tuple[int, int]) -> bool:
        """Say whether a whole frame, whose checksum is right, is of who has the key, and new."""
        if self.key is None:
            return True
        taken = _is_signed(frame) and self._is_right(frame) and self._is_new(frame, sender)
        self.refused += not taken
        return taken

    def take_key(self, key: bytes, stamp: int) -> None:
        """Use another key from now on; time stamps begin at `stamp`, or go on."""
        self.key = key
        self._stamp = max(self._stamp, min(stamp, LAST))

    def _is_right(self, frame: bytes | bytearray) -> bool:
        """Say whether the signature is that of the key."""
        digest = hashlib.sha256((self.key or b"") + frame[:-_SIGNATURE]).digest()
        return hmac.compare_digest(digest[:_SIGNATURE], bytes(frame[-_SIGNATURE:]))

    def _is_new(self, frame: bytes | bytearray, sender: tuple[int, int]) -> bool:
        """Say whether the time stamp is newer than all of its sender; remember it then."""
        stamp = int.from_bytes(frame[_STAMP], "little")
        stream = (*sender, frame[_LINK])
        last = self._last.pop(stream, None)
        if last is not None and stamp <= last:
            self._last[stream] = last
            return False
        if last is None and (stamp <= self._floor or stamp + MINUTE < self._now()):
            return False
        self._last[stream] = stamp
        if len(self._last) > MOST_STREAMS:
            self._floor = max(self._floor, self._last.pop(next(iter(self._last))))
        self._stamp = max(self._stamp, stamp)
        return True

    def _now(self) -> int:
        """Return the time stamp of now."""
        return max(self._stamp, (self._wall_ns() - _EPOCH_NS) // _UNIT_NS)


def _is_signed(frame: bytes | bytearray) -> bool:
    return frame[0] == common.PROTOCOL_MARKER_V2 and bool(frame[2] & SIGNED)
