"""Words of CiA 402-2, and process data: which object is where in which PDO.

A layout is compiled once: a frame is then packed or unpacked by one `struct.Struct`, and what a
TPDO says is one slice of a list.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from robotctl.drivers.can.nodes.identifiers import PDO_STEP, CobId

RPDO_BASES: Final = tuple(CobId.RPDO + PDO_STEP * place for place in range(4))
TPDO_BASES: Final = tuple(CobId.TPDO + PDO_STEP * place for place in range(4))
"""Predefined identifiers less the node id (CiA 301, 7.3.5)."""

FAULT, FAULT_REACTION, NOT_READY, QUICK_STOP, SWITCH_ON_DISABLED = 0, 1, 2, 3, 4
READY_TO_SWITCH_ON, SWITCHED_ON, OPERATION_ENABLED = 5, 6, 7
UNKNOWN: Final = -1
"""States of CiA 402-2, in the order in which a drive passes them on its way to power; plain numbers
since they are compared in every tick."""

STATE_NAMES: Final = {
    UNKNOWN: "an unknown state",
    FAULT: "fault",
    FAULT_REACTION: "fault reaction active",
    NOT_READY: "not ready to switch on",
    QUICK_STOP: "quick stop active",
    SWITCH_ON_DISABLED: "switch on disabled",
    READY_TO_SWITCH_ON: "ready to switch on",
    SWITCHED_ON: "switched on",
    OPERATION_ENABLED: "operation enabled",
}

STATUS_MASK: Final = 0x6F
_PATTERNS: Final = (
    (0x4F, 0x00, NOT_READY),
    (0x4F, 0x40, SWITCH_ON_DISABLED),
    (0x6F, 0x21, READY_TO_SWITCH_ON),
    (0x6F, 0x23, SWITCHED_ON),
    (0x6F, 0x27, OPERATION_ENABLED),
    (0x6F, 0x07, QUICK_STOP),
    (0x4F, 0x0F, FAULT_REACTION),
    (0x4F, 0x08, FAULT),
)
"""Mask and value of the status word in each state (CiA 402-2, table 30)."""


def _state_of(word: int) -> int:
    for mask, value, state in _PATTERNS:
        if word & mask == value:
            return state
    return UNKNOWN


STATES: Final = tuple(_state_of(word) for word in range(STATUS_MASK + 1))
"""State by status word & `STATUS_MASK`."""

INTERNAL_LIMIT: Final = 0x0800
"""Bit of the status word: a limit of the drive keeps it from what was commanded."""


class Role(enum.Enum):
    """Meaning of a part of a PDO."""

    CONTROL = "control word"
    TARGET = "target velocity"
    MODE = "mode of operation"
    STATUS = "status word"
    ERROR = "error code"
    SPEED = "actual velocity"
    POSITION = "actual position"
    CURRENT = "actual current"
    VOLTAGE = "supply voltage"
    OTHER = "something else"


Place: TypeAlias = tuple[Role, int]
"""Role of a part, and the place of its axis among those of the drive."""


@dataclass(frozen=True, slots=True)
class Mapped:
    """An object in a PDO.

    Parameters
    ----------
    index, subindex, bits
        As a mapping entry has them.
    code
        Its parts, one letter of `struct` each.
    parts
        What each of them is.
    """

    index: int
    subindex: int
    bits: int
    code: str
    parts: tuple[Place, ...]

    @property
    def entry(self) -> int:
        """The value of its mapping entry."""
        return self.index << 16 | self.subindex << 8 | self.bits


@dataclass(frozen=True, slots=True)
class Pdo:
    """A PDO with its objects.

    Parameters
    ----------
    number
        1 to 4.
    objects
        In their order.
    every
        Sent with every so many SYNC; 0: by its event timer.
    """

    number: int
    objects: tuple[Mapped, ...]
    every: int = 1

    @property
    def format(self) -> str:
        """The format of its frame for `struct`."""
        return "<" + "".join(each.code for each in self.objects)

    @property
    def parts(self) -> tuple[Place, ...]:
        """Its parts, in their order."""
        return tuple(part for each in self.objects for part in each.parts)


@dataclass(frozen=True, slots=True)
class Layout:
    """All process data of a drive.

    Parameters
    ----------
    receive
        PDOs that the drive receives.
    transmit
        PDOs that it sends.
    is_ours
        Whether the host maps them; else the drive's own mapping is used as it is.
    """

    receive: tuple[Pdo, ...]
    transmit: tuple[Pdo, ...]
    is_ours: bool = True


class Received:
    """Newest values of a drive's TPDOs.

    Parameters
    ----------
    pdos
        What the drive sends.

    Attributes
    ----------
    values
        All parts of all PDOs, in their order.
    stamps_ns
        When each PDO came last [ns]; 0: not yet.
    """

    __slots__ = ("_places", "pdos", "spans", "stamps_ns", "values")

    def __init__(self, pdos: Sequence[Pdo]) -> None:
        self.pdos = tuple(pdos)
        parts = [part for pdo in pdos for part in pdo.parts]
        self._places = {part: place for place, part in reversed(list(enumerate(parts)))}
        self.values: list[int] = [0] * len(parts)
        self.stamps_ns = [0] * len(self.pdos)
        self.spans: list[tuple[struct.Struct, slice]] = []
        """Format of each PDO, and where its values are."""
        start = 0
        for pdo in pdos:
            stop = start + len(pdo.parts)
            self.spans.append((struct.Struct(pdo.format), slice(start, stop)))
            start = stop

    def place(self, role: Role, axis: int) -> int | None:
        """Return where among `values` something is; None if no PDO carries it."""
        return self._places.get((role, axis))

    def pdo_of(self, role: Role, axis: int) -> int | None:
        """Return which PDO carries something; None if none does."""
        for number, pdo in enumerate(self.pdos):
            if (role, axis) in pdo.parts:
                return number
        return None


class Command:
    """Packs the frames of a command.

    Parameters
    ----------
    pdos
        What the drive receives.
    node_id
        Number of the drive.
    mode
        Mode of operation, for PDOs that carry it.
    """

    __slots__ = ("_frames",)

    def __init__(self, pdos: Sequence[Pdo], node_id: int, mode: int) -> None:
        self._frames = [
            (
                RPDO_BASES[pdo.number - 1] + node_id,
                struct.Struct(pdo.format).pack,
                [_source(part, mode) for part in pdo.parts],
            )
            for pdo in pdos
        ]

    def frames(self, control: int, targets: Sequence[int]) -> Iterable[tuple[int, bytes]]:
        """Return the frames of one control word for all axes, and of their target velocities."""
        values = (0, control, *targets)
        packed = []
        for arbitration_id, pack, sources in self._frames:
            packed.append(
                (
                    arbitration_id,
                    pack(*[values[source] if source >= 0 else -source for source in sources]),
                )
            )
        return packed


def _source(part: Place, mode: int) -> int:
    """Return where `Command.frames` finds a part: an index; below 0 a constant, negated."""
    role, axis = part
    if role is Role.CONTROL:
        return 1
    if role is Role.TARGET:
        return 2 + axis
    return -mode if role is Role.MODE else 0
