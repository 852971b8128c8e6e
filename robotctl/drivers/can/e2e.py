"""End-to-end protection of process data, AUTOSAR E2E profile 1: what CAN's own CRC cannot see.

The CRC itself is computed by the compiled codec; here are the counters. Source: AUTOSAR FO PRS
E2EProtocol, profile 1 (CRC-8 SAE J1850 over both bytes of the data id and the payload).
"""

from __future__ import annotations

import enum
from typing import Final

from robotctl.drivers.can.codec import compile_syndrome
from robotctl.drivers.can.dbc import Message

COUNTER_MODULUS: Final = 15
"""The alive counter runs 0..14; 15 is never sent."""


class E2eStatus(enum.Enum):
    """The receiver's verdict on the last frame. Only OK and OK_SOME_LOST may be used."""

    OK = "ok"
    OK_SOME_LOST = "some frames before it were lost"
    INITIAL = "first after start or silence"
    REPEATED = "repeated"
    WRONG_SEQUENCE = "wrong sequence"
    WRONG_CRC = "wrong CRC"
    WRONG_LENGTH = "wrong length"


_OK: Final = E2eStatus.OK


class E2eCounters:
    """Sums over all receivers of a bus since the start. A wrong length counts as a CRC reject."""

    __slots__ = ("counter_rejects", "crc_rejects", "lost")

    def __init__(self) -> None:
        self.crc_rejects = 0
        self.counter_rejects = 0
        self.lost = 0


class AliveCounter:
    """Sender side of one frame: `value` belongs into the next frame."""

    __slots__ = ("value",)

    def __init__(self) -> None:
        self.value = 0

    def advance(self) -> None:
        """Advance the counter after a frame was sent."""
        self.value = (self.value + 1) % COUNTER_MODULUS


class E2eReceiver:
    """Receiver side of one frame.

    The first good frame after the start, after `reset` or after a silence longer than the
    time-out only sets the reference. It fails to see a silence shorter than that which lasts a
    multiple of 15 frames (give or take the accepted step), and one corruption in 256 of those
    that CAN's CRC lets through.

    Parameters
    ----------
    message
        A protected message.
    timeout_ns
        Silence after which the counter is meaningless [ns].
    counters
        Where rejects and losses are counted.

    Raises
    ------
    ValueError
        If the message has no E2E protection.
    """

    __slots__ = (
        "_counters", "_last_ns", "_max_delta", "_reference", "_syndrome", "_timeout_ns", "status",
    )  # fmt: skip

    def __init__(self, message: Message, timeout_ns: int, counters: E2eCounters) -> None:
        if message.protection is None:
            raise ValueError(f"{message.name} has no E2E protection")
        self._syndrome = compile_syndrome(message)
        self._max_delta = message.protection.max_delta
        self._timeout_ns = timeout_ns
        self._counters = counters
        self._reference = -1
        self._last_ns = 0
        self.status = E2eStatus.INITIAL

    def reset(self) -> None:
        """Forget the reference, as after a restart of the sender."""
        self._reference = -1

    def accept(self, data: bytes, stamp_ns: int) -> bool:
        """Judge one frame received at `stamp_ns` [ns]; return whether it may be used."""
        if len(data) != 8:
            self._counters.crc_rejects += 1
            self.status = E2eStatus.WRONG_LENGTH
            return False
        # 0 for a valid frame: the received CRC is part of the sum.
        if self._syndrome(data):
            self._counters.crc_rejects += 1
            self.status = E2eStatus.WRONG_CRC
            return False
        counter = data[1] & 15
        reference = self._reference
        if counter == COUNTER_MODULUS:
            self._counters.counter_rejects += 1
            self.status = E2eStatus.WRONG_SEQUENCE
            return False
        # After a silence the counter may have wrapped, so this frame only sets the reference.
        silent = stamp_ns - self._last_ns > self._timeout_ns
        # Also after a wrong sequence: otherwise one jump would reject every later frame.
        self._reference = counter
        self._last_ns = stamp_ns
        if reference < 0 or silent:
            self.status = E2eStatus.INITIAL
            return False
        delta = (counter - reference) % COUNTER_MODULUS
        if delta == 1:
            self.status = _OK
            return True
        return self._judge_jump(delta)

    def _judge_jump(self, delta: int) -> bool:
        """Judge a counter that did not move by one."""
        if 1 < delta <= self._max_delta:
            # A few lost frames are normal on a noisy bus; age limits catch longer gaps.
            self._counters.lost += delta - 1
            self.status = E2eStatus.OK_SOME_LOST
            return True
        self._counters.counter_rejects += 1
        self.status = E2eStatus.WRONG_SEQUENCE if delta else E2eStatus.REPEATED
        return False
