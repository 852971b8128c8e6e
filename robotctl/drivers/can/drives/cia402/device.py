"""One drive as its EDS or its dialect describes it: what it has, and what follows from that."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from typing import Final

from robotctl.drivers.can.drives.cia402.dialects import AXIS_OFFSET, Dialect
from robotctl.drivers.can.drives.cia402.eds import Eds
from robotctl.drivers.can.drives.cia402.wire import Layout, Mapped, Pdo, Place, Role

PROFILE_VELOCITY: Final = 3
VELOCITY: Final = 2
"""Modes of operation (6060h)."""

_PDOS: Final = 4
_PARTS: Final = {
    0x6040: ("H", Role.CONTROL),
    0x6041: ("H", Role.STATUS),
    0x603F: ("H", Role.ERROR),
    0x6042: ("h", Role.TARGET),
    0x6044: ("h", Role.SPEED),
    0x6060: ("b", Role.MODE),
    0x6064: ("i", Role.POSITION),
    0x606C: ("i", Role.SPEED),
    0x6078: ("h", Role.CURRENT),
    0x60FF: ("i", Role.TARGET),
}
"""Objects of process data of the first axis."""

_BITS: Final = {"b": 8, "h": 16, "H": 16, "i": 32}


class Silence(enum.Enum):
    """Ways in which a drive notices that the host is silent."""

    OFF_LINE_TIME = "a time-out of its own"
    HEARTBEAT = "the host's heartbeat"
    GUARDING = "node guarding"
    NONE = "nothing that CANopen can set"


class Device:
    """Objects of a drive, and what follows from them.

    Parameters
    ----------
    dialect
        Its make.
    eds
        Its EDS; None: its dialect says all.
    numbers
        Numbers of its axes, from 1.
    mode
        `PROFILE_VELOCITY` or `VELOCITY`.
    """

    def __init__(
        self, dialect: Dialect, eds: Eds | None, numbers: Sequence[int], mode: int
    ) -> None:
        self.dialect = dialect
        self.eds = eds
        self.mode = mode
        self.offsets = tuple(AXIS_OFFSET * (number - 1) for number in numbers)
        self._numbers = tuple(numbers)

    def has(self, index: int, subindex: int = 0) -> bool:
        """Return whether it has an object."""
        if self.eds is not None:
            return self.eds.has(index, subindex)
        return index in (self.dialect.objects or ())

    def can_write(self, index: int, subindex: int = 0) -> bool:
        """Return whether it has an object that can be written."""
        if self.eds is not None:
            return self.eds.can_write(index, subindex)
        return self.has(index)

    @property
    def silence(self) -> Silence:
        """How it notices that the host is silent; node guarding only where there is no other."""
        if self.dialect.off_line_ms:
            return Silence.OFF_LINE_TIME
        if self.can_write(0x1016, 1):
            return Silence.HEARTBEAT
        if self.can_write(0x100C) and self.can_write(0x100D):
            return Silence.GUARDING
        return Silence.NONE

    @property
    def surely_stops(self) -> bool:
        """Whether it says of itself that it brakes when the host is silent."""
        if self.silence is Silence.OFF_LINE_TIME:
            return True
        if self.silence is Silence.NONE or not self.can_write(0x6007):
            return False
        return all(self._brakes_on_fault(offset) for offset in self.offsets)

    def _brakes_on_fault(self, offset: int) -> bool:
        """Return whether the fault reaction of an axis is, or can be made, to brake."""
        if self.can_write(0x605E + offset):
            return True
        default = None if self.eds is None else self.eds.default(0x605E + offset)
        return default in {1, 2, 3, 4}

    def layout(self) -> Layout:
        """Return its process data.

        Raises
        ------
        ValueError
            If its own mapping, which cannot be changed, has no control word, no target velocity, no
            status word or no position.
        """
        if self.dialect.layout is not None:
            return self.dialect.layout
        if self.eds is not None and not self.eds.can_write(0x1600, 1):
            return self._own_layout(self.eds)
        receive, transmit = [], []
        for axis, offset in enumerate(self.offsets):
            receive.append(Pdo(axis + 1, self._known(axis, offset, 0x6040, self._target)))
            # Of the vendor's objects one error code is that of all axes.
            first = (0x6041, self._speed, 0x603F)
            pdo = Pdo(2 * axis + 1, (*self._known(axis, offset, *first), *self._vendor_error(axis)))
            transmit += [pdo, Pdo(2 * axis + 2, self._known(axis, offset, 0x6064, 0x6078))]
        return Layout(tuple(receive), tuple(transmit))

    @property
    def _target(self) -> int:
        return 0x60FF if self.mode == PROFILE_VELOCITY else 0x6042

    @property
    def _speed(self) -> int:
        return 0x606C if self.mode == PROFILE_VELOCITY else 0x6044

    def _known(self, axis: int, offset: int, *indices: int) -> tuple[Mapped, ...]:
        """Return objects of an axis, without those that it lacks but need not have."""
        optional = {0x603F, 0x6078}
        return tuple(
            Mapped(index + offset, 0, _BITS[code], code, ((role, axis),))
            for index in indices
            for code, role in [_PARTS[index]]
            if index not in optional or self.has(index + offset)
        )

    def _vendor_error(self, axis: int) -> tuple[Mapped, ...]:
        index = self.dialect.error_object
        if index == 0x603F or axis > 0:
            return ()
        return (Mapped(index, 0, 16, "H", ((Role.ERROR, 0),)),)

    # The drive's own mapping --------------------------------------------------------------------

    def _own_layout(self, eds: Eds) -> Layout:
        """Return the mapping that the EDS has as default, as far as it is needed."""
        receive = _needed(
            [(Role.TARGET, axis) for axis in range(len(self.offsets))]
            + [(Role.CONTROL, axis) for axis in range(len(self.offsets))],
            list(self._mapped(eds, 0x1600)),
            "receives",
        )
        wanted = [
            (role, axis)
            for axis in range(len(self.offsets))
            for role in (Role.STATUS, Role.POSITION)
        ]
        extra = [
            (role, axis)
            for axis in range(len(self.offsets))
            for role in (Role.SPEED, Role.ERROR, Role.CURRENT)
        ]
        pdos = list(self._mapped(eds, 0x1A00))
        present = {part for pdo in pdos for part in pdo.parts}
        transmit = _needed(wanted + [part for part in extra if part in present], pdos, "sends")
        return Layout(receive, transmit, is_ours=False)

    def _mapped(self, eds: Eds, base: int) -> Iterator[Pdo]:
        """Yield the PDOs of the EDS."""
        for number in range(1, _PDOS + 1):
            record = base + number - 1
            entries = [
                eds.default(record, sub) or 0 for sub in range(1, (eds.default(record, 0) or 0) + 1)
            ]
            objects = tuple(self._object(entry) for entry in entries if entry)
            if objects:
                yield Pdo(number, objects)

    def _object(self, entry: int) -> Mapped:
        """Return a mapped object by its mapping entry."""
        index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        for axis, offset in enumerate(self.offsets):
            code, role = _PARTS.get(index - offset, ("", Role.OTHER))
            unwanted = role is Role.TARGET and index - offset != self._target
            unwanted |= role is Role.SPEED and index - offset != self._speed
            if code and subindex == 0 and not unwanted:
                return Mapped(index, 0, bits, code, ((role, axis),))
        return Mapped(index, subindex, bits, f"{bits // 8}x", ())


def _needed(wanted: Sequence[Place], pdos: Sequence[Pdo], verb: str) -> tuple[Pdo, ...]:
    """Return the PDOs that carry what is wanted, first those that carry most of it."""
    left, chosen = set(wanted), []
    for pdo in sorted(pdos, key=lambda each: -len(set(each.parts) & left)):
        if set(pdo.parts) & left:
            chosen.append(pdo)
            left -= set(pdo.parts)
    if left:
        missing = ", ".join(sorted(f"{role.value} of axis {axis + 1}" for role, axis in left))
        raise ValueError(f"its mapping is fixed and it {verb} no {missing}")
    return tuple(sorted(chosen, key=lambda pdo: pdo.number))
