"""Counters of the bus: frames and bits per id, errors by kind, load over a sliding window."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from firmware_sim.bus.errors import BusError

OTHER_IDS = -1
"""Key under which ids are counted together once `MAX_IDS` have been seen."""
MAX_IDS = 4096


@dataclass(slots=True)
class IdStatistics:
    """Counters of one arbitration id.

    Attributes
    ----------
    frames
        Frames completed.
    bits
        Their bits, intermission included; for CAN FD at both bit rates.
    errors
        Attempts destroyed by an error.
    """

    frames: int = 0
    bits: int = 0
    errors: int = 0


@dataclass(slots=True)
class PortStatistics:
    """Counters of one port.

    Attributes
    ----------
    sent
        Frames completed and acknowledged.
    refused
        Frames not taken by `Port.send`: queue full or bus-off.
    discarded
        Frames taken but never sent: mute, bus-off, detached.
    arbitration_lost
        Times a frame had to wait because another one won.
    errors
        Errors on the wire that this node's controller has seen.
    bus_offs
        Times the node went bus-off.
    """

    sent: int = 0
    refused: int = 0
    discarded: int = 0
    arbitration_lost: int = 0
    errors: int = 0
    bus_offs: int = 0


class LoadMeter:
    """Share of time the bus was busy in a sliding window.

    Parameters
    ----------
    window_ns
        Length of the window (ns); it slides in steps of a twentieth.
    start_ns
        Time of the bus at which counting starts.

    Attributes
    ----------
    busy_ns
        Time with a frame, an error frame or an intermission since the start (ns).
    next_mark_ns
        Time from which `mark` is due.
    """

    __slots__ = ("_marks", "_step_ns", "_window_ns", "busy_ns", "next_mark_ns")

    def __init__(self, window_ns: int, start_ns: int) -> None:
        if window_ns < 20:
            raise ValueError(f"window_ns must be >= 20: {window_ns}")
        self.busy_ns = 0
        self._window_ns = window_ns
        self._step_ns = window_ns // 20
        self._marks: deque[tuple[int, int]] = deque([(start_ns, 0)])
        self.next_mark_ns = start_ns + self._step_ns

    def mark(self, now_ns: int) -> None:
        """Note the present sum; to be called when `next_mark_ns` is reached."""
        marks = self._marks
        marks.append((now_ns, self.busy_ns))
        self.next_mark_ns = now_ns + self._step_ns
        while len(marks) > 1 and marks[1][0] <= now_ns - self._window_ns:
            marks.popleft()

    def load(self, now_ns: int) -> float:
        """Return the share [0, 1] of the last window, or since the start if that is shorter."""
        marks = self._marks
        while len(marks) > 1 and marks[1][0] <= now_ns - self._window_ns:
            marks.popleft()
        since_ns, busy_ns = marks[0]
        if now_ns <= since_ns:
            return 0.0
        return min(1.0, (self.busy_ns - busy_ns) / (now_ns - since_ns))


@dataclass(slots=True)
class BusStatistics:
    """Counters of the whole bus.

    Attributes
    ----------
    ids
        Counters by arbitration id (with flags as in `Frame`).
    errors
        Errors on the wire by kind.
    """

    ids: dict[int, IdStatistics] = field(default_factory=dict)
    errors: dict[BusError, int] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """Frames completed."""
        return sum(entry.frames for entry in self.ids.values())

    def of(self, arbitration_id: int) -> IdStatistics:
        """Return the counters of an id, made at its first use."""
        entry = self.ids.get(arbitration_id)
        if entry is None:
            key = arbitration_id if len(self.ids) < MAX_IDS else OTHER_IDS
            entry = self.ids.setdefault(key, IdStatistics())
        return entry

    def count_error(self, error: BusError, count: int = 1) -> None:
        """Count errors on the wire."""
        self.errors[error] = self.errors.get(error, 0) + count
