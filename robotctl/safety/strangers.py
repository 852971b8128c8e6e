"""Other senders on the bus: which of what they do stops the robot, and what people are told."""

from __future__ import annotations

from typing import Final

from robotctl.messages.control import Notice, Severity, Stranger, StrangerKind
from robotctl.messages.faults import Fault, FaultCode

RECENT_NS: Final = 1_000_000_000
"""Time after an unknown sender's last frame during which it keeps the robot from arming [ns]."""

FIRST_NS: Final = 1_000_000_000
"""Time from the first frame of a kind to the notice that counts it [ns]."""

NEXT_NS: Final = 10_000_000_000
"""Time from one notice of a kind to the next [ns]."""

BABBLE: Final = 10
BABBLE_NS: Final = 200_000
"""Fewest frames, and longest time between two [ns], that leave the bus to no other sender."""

_SECOND_NS: Final = 1_000_000_000
_NODE_ID: Final = 0x7F
_FAULTS: Final = {
    StrangerKind.HOST_FRAME: FaultCode.BUS_STRANGER,
    StrangerKind.SECOND_SENDER: FaultCode.NODE_DOUBLED,
    StrangerKind.FALSE_STATE: FaultCode.NODE_MISREPORTED,
}
"""Kinds that a robot must stop for. Writes to a node are refused, or found by reading back."""


class Strangers:
    """Keeps what is known of other senders."""

    def __init__(self) -> None:
        self._seen: tuple[Stranger, ...] = ()
        self._fault: Fault | None = None
        self._suspect: Stranger | None = None
        """Whose fault that is."""
        self._fault_ns = -RECENT_NS
        self._told: dict[str, int] = {}
        """Frames of each kind at its last notice."""
        self._due_ns: dict[str, int] = {}
        """When the next notice of each kind is due [ns]."""
        self._next_ns: int | None = None
        """The first of these; None: nothing is to be told."""

    def take(self, seen: tuple[Stranger, ...], now_ns: int) -> None:
        """Take what is known at `now_ns` [ns]."""
        if seen is self._seen:
            return
        before, self._seen = {_subject(each): each.count for each in self._seen}, seen
        for each in seen:
            if each.count == before.get(_subject(each), 0):
                continue
            if each.kind in _FAULTS:
                self._suspect, self._fault, self._fault_ns = each, _fault(each), now_ns
            self._due_ns.setdefault(_subject(each), now_ns + FIRST_NS)
        self._next_ns = min(self._due_ns.values(), default=None)

    def fault(self, now_ns: int) -> Fault | None:
        """Return the fault of an unknown sender that was active a moment ago [ns]."""
        return self._fault if now_ns - self._fault_ns < RECENT_NS else None

    def told(self) -> None:
        """Note that people are told of the present fault, which only more frames repeat."""
        if self._suspect is not None:
            self._told[_subject(self._suspect)] = self._suspect.count

    def take_notices(self, now_ns: int) -> list[Notice]:
        """Return the notices that are due [ns]: one for each kind, with its count."""
        if self._next_ns is None or now_ns < self._next_ns:
            return []
        notices = []
        for each in self._seen:
            subject = _subject(each)
            if now_ns < self._due_ns.get(subject, now_ns + 1):
                continue
            if each.count == self._told.get(subject, 0):
                del self._due_ns[subject]  # the next frame is told of as the first was
                continue
            self._told[subject] = each.count
            self._due_ns[subject] = now_ns + NEXT_NS
            notices.append(Notice(now_ns, Severity.WARNING, _words(each)))
        self._next_ns = min(self._due_ns.values(), default=None)
        return notices


def _subject(stranger: Stranger) -> str:
    """Return what tells one kind from another."""
    return f"{stranger.kind} {stranger.name} {stranger.node}"


def _fault(stranger: Stranger) -> Fault:
    part = stranger.name if stranger.kind is StrangerKind.HOST_FRAME else stranger.node
    return Fault(_FAULTS[stranger.kind], _words(stranger), part)


def _words(stranger: Stranger) -> str:
    """Return what another sender did, for people."""
    number = stranger.arbitration_id
    node = f"{stranger.node} (node {number & _NODE_ID})"
    frame = f"{stranger.name} (0x{number:03X})"
    times = _times(stranger)
    if _babbles(stranger):
        return f"a device babbles: {frame} came from another sender, {times}"
    match stranger.kind:
        case StrangerKind.HOST_FRAME:
            return f"{frame} came from another sender, {times}: only this computer may send it"
        case StrangerKind.SECOND_SENDER:
            return f"{frame} has a second sender beside {node}; surplus: {times}"
        case StrangerKind.FALSE_STATE:
            return f"another sender sent a {frame} for {node}, which went on as before: {times}"
        case StrangerKind.SDO_WRITE:
            refused = f", {stranger.refused} refused" if stranger.refused else ""
            return f"another sender writes to {node} by SDO: {times}{refused}"


def _babbles(stranger: Stranger) -> bool:
    """Return whether frames follow each other as fast as the bus allows."""
    span_ns = stranger.stamp_ns - stranger.first_ns
    return stranger.count >= BABBLE and span_ns < stranger.count * BABBLE_NS


def _times(stranger: Stranger) -> str:
    """Return how many frames there were, and within what time."""
    if stranger.count == 1:
        return "1 frame"
    span_ns = stranger.stamp_ns - stranger.first_ns
    time = f"{span_ns / 1e9:.1f} s" if span_ns > _SECOND_NS else f"{span_ns / 1e6:.0f} ms"
    return f"{stranger.count} frames in {time}"
