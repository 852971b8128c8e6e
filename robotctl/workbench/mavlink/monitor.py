"""Watch over a MAVLink link: rates of messages, loss, and the quality of the link."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from robotctl.messages.mavlink_port import Message, source

WINDOW_S: Final = 5.0
"""Rates and quality are those of this time [s]."""
PERIODS: Final = 3
"""Periods after which a message is overdue."""
_MOST_KINDS: Final = 1000
"""Invented senders must not fill the memory."""
_HALF: Final = 128
"""A number that is farther ahead than this came late, not early."""


class Row(NamedTuple):
    """One kind of message of one sender; `age_s` is since the last, `old` that it is overdue."""

    system: int
    component: int
    name: str
    rate_hz: float
    bytes_s: float
    total: int
    age_s: float
    old: bool


class SenderRow(NamedTuple):
    """One sender. `quality` is the share of its messages that came, nan before there are any.

    `age_s` is since its last message, `old` that all it sends regularly is overdue.
    """

    system: int
    component: int
    received: int
    lost: int
    late: int
    quality: float
    age_s: float
    old: bool


@dataclass(slots=True)
class _Kind:
    """Times [s] and sizes of the messages of one kind within the window."""

    count: int = 0
    recent: deque[tuple[float, int]] = field(default_factory=deque)
    last_s: float = 0.0
    period_s: float = WINDOW_S
    """Time between two of them, as far as that is known."""

    def is_old(self, now_s: float) -> bool:
        """Return whether the next one is overdue."""
        return now_s - self.last_s > PERIODS * self.period_s


@dataclass(slots=True)
class _Sender:
    """Sequence numbers of one sender; `recent` holds time [s], received and lost."""

    last: int | None = None
    received: int = 0
    lost: int = 0
    late: int = 0
    recent: deque[tuple[float, int, int]] = field(default_factory=deque)


class LinkMonitor:
    """Counts messages. A gap in the sequence numbers of a sender is a loss."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[int, int, str], _Kind] = {}
        self._senders: dict[tuple[int, int], _Sender] = {}
        self._begin_s: float | None = None

    def take(self, message: Message, now_s: float) -> None:
        """Take a message that came at a time [s]."""
        if self._begin_s is None:
            self._begin_s = now_s
        address = source(message)
        name = message.get_type()
        if (*address, name) not in self._kinds and len(self._kinds) >= _MOST_KINDS:
            return
        kind = self._kinds.setdefault((*address, name), _Kind())
        kind.count += 1
        _forget(kind.recent, now_s)
        kind.recent.append((now_s, len(message.get_msgbuf())))
        kind.last_s = now_s
        if len(kind.recent) > 1:
            kind.period_s = (now_s - kind.recent[0][0]) / (len(kind.recent) - 1)
        self._number(self._senders.setdefault(address, _Sender()), message.get_seq(), now_s)

    def _number(self, sender: _Sender, seq: int, now_s: float) -> None:
        """Take the sequence number of a message."""
        gap = 0 if sender.last is None else (seq - sender.last - 1) % 256
        if gap >= _HALF:  # repeated, or overtaken by others: it was counted as lost
            sender.late += 1
            return
        sender.last = seq
        sender.received += 1
        sender.lost += gap
        _forget(sender.recent, now_s)
        sender.recent.append((now_s, 1, gap))

    def rows(self, now_s: float) -> list[Row]:
        """Return all kinds of messages, by sender and name."""
        span_s = self._span_s(now_s)
        rows = []
        for (system, component, name), kind in sorted(self._kinds.items()):
            _forget(kind.recent, now_s)
            size = sum(each[1] for each in kind.recent)
            rate = len(kind.recent) / span_s
            age_s, old = now_s - kind.last_s, kind.is_old(now_s)
            bytes_s = size / span_s
            rows.append(Row(system, component, name, rate, bytes_s, kind.count, age_s, old))
        return rows

    def senders(self, now_s: float) -> list[SenderRow]:
        """Return all senders, by address."""
        rows = []
        for (system, component), sender in sorted(self._senders.items()):
            _forget(sender.recent, now_s)
            came = sum(each[1] for each in sender.recent)
            sent = came + sum(each[2] for each in sender.recent)
            quality = came / sent if sent else float("nan")
            numbers = sender.received, sender.lost, sender.late
            kinds = [kind for key, kind in self._kinds.items() if key[:2] == (system, component)]
            age_s = min((now_s - kind.last_s for kind in kinds), default=math.inf)
            old = all(kind.is_old(now_s) for kind in kinds)
            rows.append(SenderRow(system, component, *numbers, quality, age_s, old))
        return rows

    def _span_s(self, now_s: float) -> float:
        """Return the time over which rates are taken [s]."""
        began_s = now_s if self._begin_s is None else self._begin_s
        return min(max(now_s - began_s, 0.1), WINDOW_S)


def _forget(recent: deque[tuple[float, int]] | deque[tuple[float, int, int]], now_s: float) -> None:
    """Drop what is older than the window."""
    while recent and now_s - recent[0][0] > WINDOW_S:
        recent.popleft()
