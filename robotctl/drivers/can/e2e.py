"""End-to-end protection of process data, AUTOSAR E2E profile 1: what CAN's own CRC cannot see.

The CRC itself is computed by the compiled codec; here are the counters. Source: AUTOSAR FO PRS
E2EProtocol, profile 1 (CRC-8 SAE J1850 over both bytes of the data id and the payload).
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.codec import compile_syndrome
from robotctl.drivers.can.dbc import Message

COUNTER_MODULUS: Final = 15
"""Number of values of the alive counter: 0 to 14, 15 is never sent."""

SILENCE_PERIODS: Final = 12
"""Periods of silence after which a message starts over: before its counter of 15 values can wrap,
and later than the maximum age of feedback (ten periods in a simulator)."""

WINDOW_PERIODS: Final = 20
"""Periods over which frames are counted to tell a second sender."""

SURPLUS_TIMED: Final = 2
"""Surplus frames in that time that prove no second sender, of one with a timer: they may have
waited."""

SURPLUS_ON_SYNC: Final = 4
"""Surplus of a sender that answers SYNC, which comes late where the host does."""


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

    The first good frame after the start, after `reset` or after a silence of more than
    `SILENCE_PERIODS` only sets the reference. It fails to see a silence shorter than that which
    lasts a multiple of 15 frames (give or take the accepted step), and one corruption in 256 of
    those that CAN's CRC lets through.

    Of two senders each breaks the other's sequence, and together they send twice as much as one:
    `on_surplus` is called for each frame beyond those of one sender. Frames that only come out of
    order, or twice, as CAN may deliver them, are none of these.

    Parameters
    ----------
    message
        A protected message.
    period_ns
        How often it is sent [ns].
    counters
        Where rejects and losses are counted.
    surplus
        Frames more than one sender sends that are no proof of a second one.
    on_surplus
        Given the time [ns] of each frame that a second sender must have sent.

    Attributes
    ----------
    status
        Verdict on the last frame.

    Raises
    ------
    ValueError
        If the message has no E2E protection.
    """

    __slots__ = (
        "_counters", "_data", "_frames", "_frames_before", "_last_ns", "_max_delta", "_on_surplus",
        "_period_ns", "_reference", "_since_ns", "_surplus", "_syndrome", "_timeout_ns", "status",
    )  # fmt: skip

    def __init__(
        self,
        message: Message,
        period_ns: int,
        counters: E2eCounters,
        surplus: int = SURPLUS_ON_SYNC,
        on_surplus: Callable[[int], None] = lambda _: None,
    ) -> None:
        if message.protection is None:
            raise ValueError(f"{message.name} has no E2E protection")
        self._syndrome = compile_syndrome(message)
        self._max_delta = message.protection.max_delta
        self._period_ns = period_ns
        self._timeout_ns = SILENCE_PERIODS * period_ns
        self._counters = counters
        self._reference = -1
        self._last_ns = 0
        self._data = b""
        self._frames = self._frames_before = self._since_ns = 0
        self._surplus = surplus
        self._on_surplus = on_surplus
        self.status = E2eStatus.INITIAL

    def reset(self) -> None:
        """Forget the reference, as after a restart of the sender."""
        self._reference = -1

    def continued_since(self, stamp_ns: int) -> bool:
        """Return whether the last frame came after a time [ns] and went on from the one before."""
        return self.status is _OK and self._last_ns > stamp_ns

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
        self._frames += 1
        before, self._data = self._data, data
        if reference < 0 or silent:
            self.status = E2eStatus.INITIAL
            return False
        delta = (counter - reference) % COUNTER_MODULUS
        if delta == 1:
            self.status = _OK
            return True
        if delta == 0 and data == before:
            self._frames -= 1  # the same frame again, which CAN may deliver twice
        else:
            self._count_surplus(stamp_ns)
        return self._judge_jump(delta)

    def _count_surplus(self, stamp_ns: int) -> None:
        """Count the frames that one sender cannot have sent."""
        elapsed_ns = stamp_ns - self._since_ns
        if elapsed_ns > WINDOW_PERIODS * self._period_ns:
            self._since_ns, self._frames_before = stamp_ns, self._frames
            return
        sent = elapsed_ns // self._period_ns + self._surplus
        if self._frames - self._frames_before > sent:
            self._frames_before += 1
            self._on_surplus(stamp_ns)

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
