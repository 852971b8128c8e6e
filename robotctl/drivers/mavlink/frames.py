"""Finds MAVLink frames in a stream of bytes.

pymavlink's own stream parser skips a whole frame length after a wrong checksum, so garbage that
looks like a header swallows the good frames behind it, and it never frees a buffer that always
ends in half a frame. This one steps on by a byte and leaves the decoding to `MAVLink.decode`.
"""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import common

import robotctl.dialect  # noqa: F401 - the codec knows its messages
from robotctl.drivers.mavlink.signing import Signing
from robotctl.messages.mavlink_port import Message, source

MARKER_V1: int = common.PROTOCOL_MARKER_V1
MARKER_V2: int = common.PROTOCOL_MARKER_V2
HEADER_V1: int = common.HEADER_LEN_V1
HEADER_V2: int = common.HEADER_LEN_V2
SIGNED: int = common.MAVLINK_IFLAG_SIGNED
SIGNATURE: int = common.MAVLINK_SIGNATURE_BLOCK_LEN
STALE_NS = 300_000_000
"""Time without a new byte after which a frame will not be completed [ns]."""

FORGET_NS = 10_000_000_000
"""Time without MAVLink 2 after which a MAVLink 1 sender speaks only 1 [ns]: another program may be
at the end of the line."""

_FREE = frozenset({common.MAVLINK_MSG_ID_RADIO_STATUS})
"""Messages that need no signature: radios have no key."""

# The environment must not be able to switch off the check that keeps corrupt commands out.
common.MAVLINK_IGNORE_CRC = 0


class FrameReader:
    """Turns bytes into messages, one reader for each sender.

    Accepts MAVLink 1 and 2. `bad_bytes` counts bytes of no valid frame, `unknown` frames whose
    message is not in the dialect (they are skipped).

    Parameters
    ----------
    codec : pymavlink.dialects.v20.common.MAVLink
        Decodes one complete frame; it has no key.
    signing : Signing
        Says which frames are taken.
    record : callable
        Given each frame that is taken, but those that bring a key.
    safe : bool
        Whether SETUP_SIGNING is taken without a signature.
    """

    def __init__(
        self,
        codec: common.MAVLink,
        signing: Signing | None = None,
        record: Callable[[bytearray], object] = lambda _: None,
        *,
        safe: bool = False,
    ) -> None:
        self._record = record
        self._codec = codec
        self._signing = signing or Signing()
        self._free = _FREE | {common.MAVLINK_MSG_ID_SETUP_SIGNING} if safe else _FREE
        self._buffer = bytearray()
        self._last_ns = 0
        self._v2_ns: int | None = None
        self.bad_bytes = 0
        self.unknown = 0
        self.is_v1 = False
        """Whether the sender has used only MAVLink 1."""
        self.newest = 0
        """Time stamp that signed frames for the sender have to exceed."""
        self.late = 0
        """Number of frames signed with the key that came too late."""

    def feed(self, data: bytes, now_ns: int) -> list[Message]:
        """Take bytes of a stream; return the messages they complete."""
        messages = self.expire(now_ns)
        self._last_ns = now_ns
        self._buffer += data
        self._scan(messages, final=False)
        return messages

    def feed_datagram(self, data: bytes, now_ns: int) -> list[Message]:
        """Take a datagram: one that starts with a frame ends a frame begun in an earlier one.

        Frames split over datagrams are put together, since bridges from serial lines send them.
        """
        messages: list[Message] = []
        # A datagram that begins with a marker is not the rest of the earlier frame.
        if self._buffer and data[:1] in (b"\xfd", b"\xfe"):
            self._scan(messages, final=True)
        messages += self.feed(data, now_ns)
        return messages

    def expire(self, now_ns: int) -> list[Message]:
        """Drop a frame left incomplete too long; return messages found after its start."""
        messages: list[Message] = []
        if self._buffer and now_ns - self._last_ns > STALE_NS:
            self._scan(messages, final=True)
        return messages

    def _scan(self, messages: list[Message], *, final: bool) -> None:
        """Decode all frames of the buffer; keep the last half frame unless this is `final`."""
        buffer = self._buffer
        position = 0
        while (start := _find_marker(buffer, position)) < len(buffer):
            self.bad_bytes += start - position
            length = self._frame_length(start)
            incomplete = start + length > len(buffer)
            if incomplete and not final:
                position = start
                break
            if length and not incomplete and self._decode(start, length, messages):
                position = start + length
            else:
                self.bad_bytes += 1
                position = start + 1
        else:
            self.bad_bytes += start - position
            position = start
        del buffer[:position]

    def _frame_length(self, start: int) -> int:
        """Return the frame's length, or the header's while it is incomplete, or 0: no frame."""
        buffer = self._buffer
        available = len(buffer) - start
        if buffer[start] == MARKER_V2:
            if available < HEADER_V2:
                return 0 if available > 2 and buffer[start + 2] & ~SIGNED else HEADER_V2
            flags = buffer[start + 2]
            if flags & ~SIGNED:
                return 0
            signature = SIGNATURE if flags & SIGNED else 0
            return HEADER_V2 + buffer[start + 1] + 2 + signature
        if available < HEADER_V1:
            return HEADER_V1
        kind = common.mavlink_map.get(buffer[start + 5])
        # A payload longer than the definition of its message: garbage that looks like a header.
        if kind is not None and buffer[start + 1] > kind.unpacker.size:
            return 0
        return HEADER_V1 + buffer[start + 1] + 2

    def _decode(self, start: int, length: int, messages: list[Message]) -> bool:
        """Append the message of one complete frame; False if it is none."""
        buffer = self._buffer
        end = start + length
        try:
            message = self._codec.decode(buffer[start:end])
        except common.MAVError:
            return False
        if not self._is_taken(message, buffer[start:end]):
            return True
        if buffer[start] == MARKER_V2:
            self._v2_ns, self.is_v1 = self._last_ns, False
        elif self._v2_ns is None or self._last_ns - self._v2_ns > FORGET_NS:
            self.is_v1 = True
        if isinstance(message, common.MAVLink_unknown):
            # Its checksum cannot be known; what follows it distinguishes a frame from garbage. Its
            # inside is not searched: messages that carry others must not be taken apart.
            if end < len(buffer) and buffer[end] not in (MARKER_V1, MARKER_V2):
                return False
            self.unknown += 1
            return True
        messages.append(message)
        if message.get_msgId() != common.MAVLINK_MSG_ID_SETUP_SIGNING:
            self._record(buffer[start:end])
        return True

    def _is_taken(self, message: Message, frame: bytearray) -> bool:
        """Say whether who has sent a frame may talk to the robot."""
        if message.get_msgId() in self._free:
            return True
        verdict = self._signing.judge(frame, source(message))
        self.newest = max(self.newest, verdict.stamp)
        self.late += verdict.stamp > 0 and not verdict.taken
        return verdict.taken


def _find_marker(buffer: bytearray, position: int) -> int:
    """Return where the next frame may start, the buffer's length if nowhere."""
    end = len(buffer)
    first = buffer.find(MARKER_V2, position)
    second = buffer.find(MARKER_V1, position, end if first < 0 else first)
    if second >= 0:
        return second
    return end if first < 0 else first
