"""Faults of the bus as values: kind, nodes concerned, time and frequency.

A `FaultPlan` is data: two runs with the same plan, seed and traffic are the same bit by bit.
Times are times of the bus (ns). Where several faults fit one frame, the first of the plan that
strikes counts.

There is no clock drift of nodes: below the tolerance of bit timing (1.58 %) it is invisible on the
wire, and a node's own timers belong to the node (`firmware_sim.nodes.clock`).
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_sim.bus.errors import BusError
from firmware_sim.bus.frame import FD_LENGTHS


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFault:
    """Which frames a fault strikes; every given condition must hold.

    Attributes
    ----------
    arbitration_id
        Id with flags as in `Frame`, for CAN FD those of the sender (BRS, ESI) or none; None: any.
    node
        Name of the sending port; None: any.
    start_ns, end_ns
        Only frames from start (included) to end (excluded); None: without end.
    first
        Number of matching frames that pass before the fault may strike (0: strikes the first).
    count
        Maximum number of strikes; None: without limit.
    probability
        Probability (0..1] of striking a matching frame, drawn from the bus's generator.
    """

    arbitration_id: int | None = None
    node: str | None = None
    start_ns: int = 0
    end_ns: int | None = None
    first: int = 0
    count: int | None = None
    probability: float = 1.0

    def __post_init__(self) -> None:
        _check_window(self.start_ns, self.end_ns)
        if self.first < 0 or (self.count is not None and self.count < 1):
            raise ValueError(f"first must be >= 0 and count >= 1: {self.first}, {self.count}")
        if not 0.0 < self.probability <= 1.0:
            raise ValueError(f"probability must be in (0, 1]: {self.probability}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Destroy(FrameFault):
    """The frame is destroyed by an error on the wire and sent again by its controller.

    Each attempt counts as a frame of its own for `first` and `count`.

    Attributes
    ----------
    error
        BIT_ERROR: the transmitter sees it. CRC_ERROR, FORM_ERROR, BIT_STUFFING_ERROR: receivers do.
        ACK_ERROR follows from missing acknowledgement and cannot be requested here.
    bit
        Bit after the start of frame at which the error is seen; None: drawn, or the fixed place
        of this kind of error.
    receiver
        Name of the one port which sees the error; None: all receivers.
    """

    error: BusError = BusError.CRC_ERROR
    bit: int | None = None
    receiver: str | None = None

    def __post_init__(self) -> None:
        FrameFault.__post_init__(self)
        if self.error in (BusError.ACK_ERROR, BusError.BROKEN_ERROR):
            raise ValueError(f"{self.error.name} cannot be injected into a frame")
        if self.error is BusError.BIT_ERROR and self.receiver is not None:
            raise ValueError("a BIT_ERROR is seen by the transmitter: it has no receiver")
        if self.bit is not None and self.bit < 1:
            raise ValueError(f"bit must be >= 1: {self.bit}")


@dataclass(frozen=True, slots=True, kw_only=True)
class BitErrors(FrameFault):
    """Random bit errors at the transmitter; each destroys the frame.

    Attributes
    ----------
    rate
        Probability (0..1) that one bit is disturbed.
    """

    rate: float

    def __post_init__(self) -> None:
        FrameFault.__post_init__(self)
        if not 0.0 < self.rate < 1.0:
            raise ValueError(f"rate must be in (0, 1): {self.rate}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drop(FrameFault):
    """The frame is fine on the wire and acknowledged, but lost inside the receiving node.

    Attributes
    ----------
    receiver
        Name of the port that loses it; None: all lose it.
    """

    receiver: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Duplicate(FrameFault):
    """The sender sends the frame twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay(FrameFault):
    """The sender hands the frame to its controller late; others may overtake it.

    Attributes
    ----------
    delay_ns
        Delay (ns).
    """

    delay_ns: int

    def __post_init__(self) -> None:
        FrameFault.__post_init__(self)
        if self.delay_ns <= 0:
            raise ValueError(f"delay_ns must be > 0: {self.delay_ns}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reorder(FrameFault):
    """The sender sends the frame after its next one with the same id."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stale(FrameFault):
    """Instead of the frame, the sender repeats the last one it really sent.

    A first frame is sent unchanged.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrupt(FrameFault):
    """The payload changes in the sender's memory: the CRC fits, only E2E protection sees it.

    Attributes
    ----------
    xor
        Bits to invert, from byte 0 on; None: one bit drawn at random. An empty payload stays.
    """

    xor: bytes | None = None

    def __post_init__(self) -> None:
        FrameFault.__post_init__(self)
        if self.xor is not None and not (0 < len(self.xor) <= FD_LENGTHS[-1] and any(self.xor)):
            raise ValueError(f"xor must invert something within 64 bytes: {self.xor!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeFault:
    """Behaviour of one node from `start_ns` (included) to `end_ns` (excluded; None: for good)."""

    node: str
    start_ns: int = 0
    end_ns: int | None = None

    def __post_init__(self) -> None:
        _check_window(self.start_ns, self.end_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mute(NodeFault):
    """The node's program hangs: it sends nothing; its controller still acknowledges."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AckLess(NodeFault):
    """The node's controller sends and receives but acknowledges nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unanswered(NodeFault):
    """No node acknowledges the node's frames, even nodes that join meanwhile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Babble(NodeFault):
    """The node sends one frame again and again, before all its own.

    Attributes
    ----------
    arbitration_id, data
        The frame. A low id keeps every other node off the bus.
    period_ns
        One frame each period; 0: without a pause.
    """

    arbitration_id: int = 0
    data: bytes = bytes(8)
    period_ns: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """The wire is cut: the node, or with None every node, neither sends nor receives.

    A cut-off node which sends gets acknowledge errors until it is error-passive.
    """

    node: str | None = None
    start_ns: int = 0
    end_ns: int | None = None

    def __post_init__(self) -> None:
        _check_window(self.start_ns, self.end_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dominant:
    """The bus is held dominant (a short circuit): no frame passes.

    The sender goes bus-off; all others become error-passive.
    """

    start_ns: int = 0
    end_ns: int | None = None

    def __post_init__(self) -> None:
        _check_window(self.start_ns, self.end_ns)


Fault = FrameFault | NodeFault | Cut | Dominant
"""Any fault of this module."""


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """All faults of a run; empty by default."""

    faults: tuple[Fault, ...] = ()


def _check_window(start_ns: int, end_ns: int | None) -> None:
    if start_ns < 0 or (end_ns is not None and end_ns <= start_ns):
        raise ValueError(f"a fault must end after it starts: {start_ns}..{end_ns} ns")
