"""The objects that every node has: the communication profile of CiA 301."""

from __future__ import annotations

from typing import Final

from firmware_sim.nodes.variables import Access, DataType, Kind, Member, Object, compound, variable

DEVICE_TYPE: Final = 0x1000
ERROR_REGISTER: Final = 0x1001
ERROR_FIELD: Final = 0x1003
STORE: Final = 0x1010
RESTORE: Final = 0x1011
HEARTBEAT_TIME: Final = 0x1017
IDENTITY: Final = 0x1018

VENDOR_ID: Final = 0x00526F62
"""ASCII "Rob"; not assigned by CiA."""
REVISION: Final = 0x00010000
ERROR_FIELD_LENGTH: Final = 8
PDO_MISSING: Final = 1 << 31
SIGNATURE_SAVE: Final = 0x65766173
SIGNATURE_LOAD: Final = 0x64616F6C

_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_TEXT = DataType.VISIBLE_STRING
_RO, _RW, _CONST = Access.RO, Access.RW, Access.CONST


def standard_objects(node_id: int, device_name: str, product_code: int) -> list[Object]:
    """Return the communication-profile objects 0x1000..0x1018 of a node.

    The serial number is the product code times 1000 plus one, since there is one robot.
    """
    identity = (
        Member("Vendor-ID", _U32, _RO, VENDOR_ID),
        Member("Product code", _U32, _RO, product_code),
        Member("Revision number", _U32, _RO, REVISION),
        Member("Serial number", _U32, _RO, product_code * 1000 + 1),
    )
    history = [
        Member(f"Standard error field {number}", _U32, _RO, 0)
        for number in range(1, ERROR_FIELD_LENGTH + 1)
    ]
    return [
        variable(DEVICE_TYPE, "Device type", _U32, _CONST, 0),
        variable(ERROR_REGISTER, "Error register", _U8, _RO, 0),
        compound(
            ERROR_FIELD,
            "Pre-defined error field",
            Kind.ARRAY,
            history,
            count_name="Number of errors",
            count_access=_RW,
            count=0,
        ),
        variable(0x1005, "COB-ID SYNC", _U32, _CONST, 0x80),
        variable(0x1008, "Manufacturer device name", _TEXT, _CONST, device_name),
        variable(0x1009, "Manufacturer hardware version", _TEXT, _CONST, "simulated"),
        variable(0x100A, "Manufacturer software version", _TEXT, _CONST, "1.0"),
        compound(
            STORE, "Store parameters", Kind.ARRAY, [Member("Save all parameters", _U32, _RW, 1)]
        ),
        compound(
            RESTORE,
            "Restore default parameters",
            Kind.ARRAY,
            [Member("Restore all default parameters", _U32, _RW, 1)],
        ),
        variable(0x1014, "COB-ID EMCY", _U32, _CONST, 0x80 + node_id),
        variable(
            HEARTBEAT_TIME, "Producer heartbeat time", _U16, _RW, 100, low=0, high=0xFFFF,
            stored=True,
        ),
        compound(IDENTITY, "Identity object", Kind.RECORD, identity),
    ]  # fmt: skip


def pdo_communication(
    index: int,
    name: str,
    cob_id: int,
    transmission_type: int,
    *,
    configurable: bool = False,
    exists: bool = True,
) -> Object:
    """Return a PDO communication parameter record (0x1400.., 0x1800..).

    A `configurable` transmission type is 1..240: the PDO is sent on every n-th SYNC. A PDO that
    does not exist has bit 31 of its COB-ID set (CiA 301, 7.5.2.35).
    """
    cob_id |= 0 if exists else PDO_MISSING
    kind = (
        Member("Transmission type", _U8, _RW, transmission_type, 1, 240, stored=True)
        if configurable
        else Member("Transmission type", _U8, _CONST, transmission_type)
    )
    return compound(index, name, Kind.RECORD, [Member("COB-ID", _U32, _CONST, cob_id), kind])


def pdo_mapping(index: int, name: str, image: int) -> Object:
    """Return a PDO mapping record: the PDO is the whole object `image`, see `pdo_image`."""
    mapped = Member("Mapped object 1", _U32, _CONST, image << 16 | 64)
    return compound(index, name, Kind.RECORD, [mapped], count_name="Number of mapped objects")


def pdo_image(index: int, name: str, access: Access = Access.RO) -> Object:
    """Return the object that a PDO maps: its whole payload, laid out as in robot.dbc."""
    return variable(index, name, DataType.UNSIGNED64, access, 0, mappable=True)
