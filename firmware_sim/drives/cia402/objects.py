"""Object dictionaries of the dialects.

Indices, types, access and defaults are those of CiA 301, CiA 402-2, the EDS of the ZLAC8015D
(NamPER221/base-canopen@abfab4d) and the objects that rock-drivers' motors_roboteq_canopen uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.nodes.variables import Access, DataType, Kind, Member, Object, compound, variable

PDOS: Final = 4
ENTRIES: Final = 4
"""Maximum objects in a PDO of these drives."""
INVALID: Final = 0x8000_0000
RPDO_BASES: Final = (0x200, 0x300, 0x400, 0x500)
TPDO_BASES: Final = (0x180, 0x280, 0x380, 0x480)
AXIS_OFFSET: Final = 0x800

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_RO, _RW, _CONST = Access.RO, Access.RW, Access.CONST


def objects_of(dialect: str, node_id: int, axes: int, settings: Cia402Settings) -> Iterator[Object]:
    """Yield the objects of a drive of a dialect, without those that its firmware lacks."""
    lacks = {int(index, 16) for index in settings.lacks}
    parts = [_communication(node_id, settings), _pdos(node_id)]
    if dialect == "zlac8015d":
        parts.append(_zlac8015d())
    else:
        lacks |= {0x6007, 0x605A, 0x605E, 0x1016, 0x1029} if dialect == "roboteq" else set()
        parts += [_connection(), *(_axis(AXIS_OFFSET * axis, settings) for axis in range(axes))]
    if dialect == "roboteq":
        parts.append(_roboteq())
    for part in parts:
        for each in part:
            if each.index not in lacks:
                yield each


def _communication(node_id: int, settings: Cia402Settings) -> Iterator[Object]:
    yield variable(0x1000, "Device type", _U32, _CONST, 0x0002_0000 | settings.profile)
    yield variable(0x1001, "Error register", _U8, _RO, 0)
    yield variable(0x1005, "COB-ID SYNC", _U32, _RW, 0x80)
    yield compound(0x1010, "Store parameters", Kind.ARRAY, [Member("Save all", _U32, _RW, 1)])
    yield variable(0x1014, "COB-ID EMCY", _U32, _RW, 0x80 + node_id)
    yield variable(0x1017, "Producer heartbeat time", _U16, _RW, 0, stored=True)
    yield compound(
        0x1018,
        "Identity object",
        Kind.RECORD,
        [
            Member("Vendor-ID", _U32, _RO, settings.vendor),
            Member("Product code", _U32, _RO, settings.product),
        ],
    )


def _connection() -> Iterator[Object]:
    """Yield the objects for the detection of a silent host, and the reaction to it."""
    yield variable(0x100C, "Guard time", _U16, _RW, 0)
    yield variable(0x100D, "Life time factor", _U8, _RW, 0)
    yield compound(
        0x1016, "Consumer heartbeat time", Kind.ARRAY, [Member("Consumer 1", _U32, _RW, 0)]
    )
    yield compound(
        0x1029,
        "Error behaviour",
        Kind.ARRAY,
        [Member("Communication error", _U8, _RW, 0, high=2)],
    )
    yield variable(0x6007, "Abort connection option code", _I16, _RW, 0, low=0, high=3)
    yield variable(0x6079, "DC link circuit voltage", _U32, _RO, 0, mappable=True)


def _pdos(node_id: int) -> Iterator[Object]:
    for word, communication, mapping, bases in (
        ("Receive", 0x1400, 0x1600, RPDO_BASES),
        ("Transmit", 0x1800, 0x1A00, TPDO_BASES),
    ):
        for place, base in enumerate(bases):
            yield compound(
                communication + place,
                f"{word} PDO {place + 1} parameter",
                Kind.RECORD,
                [
                    Member("COB-ID", _U32, _RW, INVALID | (base + node_id)),
                    Member("Transmission type", _U8, _RW, 0xFF),
                    Member("Inhibit time", _U16, _RW, 0),
                    Member("Compatibility entry", _U8, _RW, 0),
                    Member("Event timer", _U16, _RW, 0),
                ],
            )
            yield compound(
                mapping + place,
                f"{word} PDO {place + 1} mapping",
                Kind.RECORD,
                [Member(f"Object {each + 1}", _U32, _RW, 0) for each in range(ENTRIES)],
                count_access=_RW,
                count=0,
            )


def _axis(offset: int, settings: Cia402Settings) -> Iterator[Object]:
    """Yield the standard objects of one axis."""
    rated_ma = round(1000.0 * settings.rated_current_a)
    for index, name, kind, access, default in (
        (0x603F, "Error code", _U16, _RO, 0),
        (0x6040, "Controlword", _U16, _RW, 0),
        (0x6041, "Statusword", _U16, _RO, 0),
        (0x6042, "vl target velocity", _I16, _RW, 0),
        (0x6043, "vl velocity demand", _I16, _RO, 0),
        (0x6044, "vl velocity actual value", _I16, _RO, 0),
        (0x605A, "Quick stop option code", _I16, _RW, 2),
        (0x605B, "Shutdown option code", _I16, _RW, 0),
        (0x605C, "Disable operation option code", _I16, _RW, 1),
        (0x605D, "Halt option code", _I16, _RW, 1),
        (0x605E, "Fault reaction option code", _I16, _RW, 2),
        (0x6060, "Modes of operation", _I8, _RW, 0),
        (0x6061, "Modes of operation display", _I8, _RO, 0),
        (0x6064, "Position actual value", _I32, _RO, 0),
        (0x606C, "Velocity actual value", _I32, _RO, 0),
        (0x6075, "Motor rated current", _U32, _RW, rated_ma),
        (0x6078, "Current actual value", _I16, _RO, 0),
        (0x6083, "Profile acceleration", _U32, _RW, 10_000),
        (0x6084, "Profile deceleration", _U32, _RW, 10_000),
        (0x6085, "Quick stop deceleration", _U32, _RW, 10_000),
        (0x60FF, "Target velocity", _I32, _RW, 0),
        (0x6502, "Supported drive modes", _U32, _RO, 0x06),
    ):
        yield variable(
            index + offset, name, kind, access, default, mappable=True, stored=index >= 0x6075
        )
    for index, name in (
        (0x6048, "vl velocity acceleration"),
        (0x6049, "vl velocity deceleration"),
        (0x604A, "vl velocity quick stop"),
    ):
        members = [Member("Delta speed", _U32, _RW, 1000), Member("Delta time", _U16, _RW, 1)]
        yield compound(index + offset, name, Kind.RECORD, members)


def _pair(index: int, name: str, kind: DataType, access: Access, default: int = 0) -> Object:
    """Return an object with the left wheel in sub-index 1 and the right one in 2."""
    members = [Member(f"Left {name}", kind, access, default)]
    members.append(Member(f"Right {name}", kind, access, default))
    return compound(index, name, Kind.ARRAY, members)


def _zlac8015d() -> Iterator[Object]:
    yield variable(0x2000, "Offline communication", _U16, _RW, 0, stored=True)
    yield variable(0x200F, "Synchronous control", _U16, _RW, 0, high=1, stored=True)
    yield _pair(0x200E, "encoder lines", _U16, _RW, 1024)
    yield variable(0x2010, "EEPROM", _U16, _RW, 0, high=1)
    yield variable(0x2031, "Software version", _U16, _RO, 0)
    yield _pair(0x2032, "motor temperature", _U16, _RO)
    yield variable(0x2035, "Bus voltage", _U16, _RO, 0)
    yield variable(0x603F, "Error code", _U32, _RO, 0)
    yield variable(0x6040, "Controlword", _U16, _RW, 0)
    yield variable(0x6041, "Statusword", _U32, _RO, 0)
    yield variable(0x605B, "Shutdown option code", _I16, _RW, 1, low=0, high=1)
    yield variable(0x605C, "Disable operation option code", _I16, _RW, 1, low=0, high=1)
    yield variable(0x605D, "Halt option code", _I16, _RW, 1, low=1, high=3)
    yield variable(0x6060, "Modes of operation", _I8, _RW, 0, low=0, high=4)
    yield variable(0x6061, "Modes of operation display", _I8, _RO, 0)
    yield _pair(0x6064, "position", _I32, _RO)
    yield _pair(0x606C, "velocity", _I32, _RO)
    torques = [Member(name, _I16, _RO, 0) for name in ("Left torque", "Right torque")]
    yield compound(0x6077, "Torque", Kind.ARRAY, [*torques, Member("Both torques", _U32, _RO, 0)])
    yield _pair(0x6083, "acceleration time", _U32, _RW, 500)
    yield _pair(0x6084, "deceleration time", _U32, _RW, 500)
    yield _pair(0x6085, "quick stop time", _U32, _RW, 10)
    targets = [Member(name, _I32, _RW, 0, -1000, 1000) for name in ("Left target", "Right target")]
    yield compound(
        0x60FF, "Target velocity", Kind.ARRAY, [*targets, Member("Both targets", _U32, _RW, 0)]
    )


def _roboteq() -> Iterator[Object]:
    amps = [Member(f"Channel {channel}", _I16, _RO, 0) for channel in (1, 2)]
    yield compound(0x2100, "Motor amps", Kind.ARRAY, amps)
    volts = [Member(name, _U16, _RO, 0) for name in ("Internal", "Battery", "5 V")]
    yield compound(0x210D, "Voltages", Kind.ARRAY, volts)
    heat = [Member(name, _I8, _RO, 0) for name in ("MCU", "Sensor")]
    yield compound(0x210F, "Temperatures", Kind.ARRAY, heat)
    yield variable(0x2112, "Fault flags", _U16, _RO, 0)


def indices(objects: Iterable[Object]) -> frozenset[int]:
    """Return the indices of objects."""
    return frozenset(each.index for each in objects)
