"""Object dictionary of the motor controller, as in configs/motor_controller.eds."""

from __future__ import annotations

from typing import Final

from firmware_sim.nodes import wire
from firmware_sim.nodes.standard_objects import (
    pdo_communication,
    pdo_image,
    pdo_mapping,
    standard_objects,
)
from firmware_sim.nodes.variables import Access, DataType, Kind, Member, Object, compound, variable

NODE_ID: Final = 1
DEVICE_NAME: Final = "robotctl drive"
PRODUCT_CODE: Final = 1

COMMAND_TIMEOUT: Final = 0x2000
PROTOCOL_VERSION: Final = 0x2001
COUNTS_PER_REVOLUTION: Final = 0x2002
CURRENT_LIMIT: Final = 0x2003
TEMPERATURE_LIMIT: Final = 0x2004
VOLTAGE_LIMIT: Final = 0x2005
CLEAR_FAULTS: Final = 0x2010
DIAGNOSTICS: Final = 0x2100
COMMAND_IMAGE: Final = 0x2110
FEEDBACK_IMAGE: Final = 0x2111
MOTOR_STATUS_IMAGE: Final = 0x2112
DRIVE_STATUS_IMAGE: Final = 0x2113
MOTOR_STATUS_PDO: Final = 0x1801
DRIVE_STATUS_PDO: Final = 0x1802

DEFAULT_COUNTS_PER_REVOLUTION: Final = 2400
DEFAULT_CURRENT_LIMIT_MA: Final = 5000

_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_RO, _RW, _WO = Access.RO, Access.RW, Access.WO

_DIAGNOSTICS = (
    "Accepted commands",
    "CRC rejects",
    "Counter rejects",
    "Length and range rejects",
    "Command time-outs",
    "Emergency stops",
)


def drive_objects(
    counts_per_revolution: int = DEFAULT_COUNTS_PER_REVOLUTION,
    current_limit_ma: int = DEFAULT_CURRENT_LIMIT_MA,
) -> list[Object]:
    """Return all objects of the drive, in ascending order.

    Parameters
    ----------
    counts_per_revolution
        Quadrature counts per turn of the wheel: the board's build.
    current_limit_ma
        Default of 0x2003 [mA], 100..200000.
    """
    return [
        *standard_objects(NODE_ID, DEVICE_NAME, PRODUCT_CODE),
        pdo_communication(0x1400, "RPDO 1 communication", wire.MOTOR_COMMAND, 255),
        pdo_mapping(0x1600, "RPDO 1 mapping", COMMAND_IMAGE),
        pdo_communication(0x1800, "TPDO 1 communication", wire.WHEEL_FEEDBACK, 1),
        pdo_communication(
            MOTOR_STATUS_PDO, "TPDO 2 communication", wire.MOTOR_STATUS, 4, configurable=True
        ),
        pdo_communication(
            DRIVE_STATUS_PDO, "TPDO 3 communication", wire.DRIVE_STATUS, 4, configurable=True
        ),
        pdo_mapping(0x1A00, "TPDO 1 mapping", FEEDBACK_IMAGE),
        pdo_mapping(0x1A01, "TPDO 2 mapping", MOTOR_STATUS_IMAGE),
        pdo_mapping(0x1A02, "TPDO 3 mapping", DRIVE_STATUS_IMAGE),
        variable(
            COMMAND_TIMEOUT, "Command time-out [ms]", _U16, _RW, 100, low=2, high=2000, stored=True
        ),
        variable(PROTOCOL_VERSION, "Wire-protocol version", _U32, _RO, wire.PROTOCOL_VERSION),
        variable(
            COUNTS_PER_REVOLUTION, "Counts per revolution", _U32, _RO, counts_per_revolution
        ),
        variable(
            CURRENT_LIMIT, "Current limit [mA]", _U32, _RW, current_limit_ma,
            low=100, high=200_000, stored=True,
        ),
        variable(
            TEMPERATURE_LIMIT, "Over-temperature limit [degC]", _U8, _RW, 120,
            low=40, high=200, stored=True,
        ),
        variable(
            VOLTAGE_LIMIT, "Under-voltage limit [mV]", _U16, _RW, 9000,
            low=0, high=60_000, stored=True,
        ),
        variable(CLEAR_FAULTS, "Clear faults", _U8, _WO, 0, low=1, high=1),
        compound(
            DIAGNOSTICS,
            "Diagnostic counters",
            Kind.ARRAY,
            [Member(name, _U32, _RO, 0) for name in _DIAGNOSTICS],
        ),
        pdo_image(COMMAND_IMAGE, "Motor command", _RW),
        pdo_image(FEEDBACK_IMAGE, "Wheel feedback"),
        pdo_image(MOTOR_STATUS_IMAGE, "Motor status"),
        pdo_image(DRIVE_STATUS_IMAGE, "Drive status"),
    ]  # fmt: skip
