"""Frames of CANSimple: 11-bit identifiers, a node number above five bits of command.

Sources: the DBC files of firmware 0.5.6 and 0.6.10 in the package odrive-can 2.1.0; for 0.5 also
odriverobotics/ODrive, Firmware/communication/can/can_simple.cpp (Estop, and that a remote request
is answered with a frame of the same identifier); for 0.6 odriverobotics/ODriveResources,
examples/can_param_access.py (SDO). All numbers are little-endian, positions and speeds in turns of
the motor.
"""

from __future__ import annotations

import enum
import struct
from typing import Final, NamedTuple

from robotctl.messages.ports import REMOTE_FLAG

NODE_ID_MAX: Final = 62
"""Greatest number of a node; 63 addresses all that have none of their own."""


class Command(enum.IntEnum):
    """Lower five bits of an identifier, in both firmwares."""

    HEARTBEAT = 0x01
    ESTOP = 0x02
    SET_AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    SET_CONTROLLER_MODE = 0x0B
    SET_INPUT_VEL = 0x0D
    IQ = 0x14
    BUS_VOLTAGE_CURRENT = 0x17
    CLEAR_ERRORS = 0x18


class OldCommand(enum.IntEnum):
    """Commands that only firmware 0.5 has."""

    MOTOR_ERROR = 0x03
    ENCODER_ERROR = 0x04
    ENCODER_COUNT = 0x0A
    CONTROLLER_ERROR = 0x1D


class NewCommand(enum.IntEnum):
    """Commands that only firmware 0.6 has."""

    VERSION = 0x00
    ERROR = 0x03
    RX_SDO = 0x04
    TX_SDO = 0x05
    TEMPERATURE = 0x15


HOST_FRAMES: Final[dict[int, str]] = {
    Command.ESTOP: "Estop",
    Command.SET_AXIS_STATE: "Set_Axis_State",
    Command.SET_CONTROLLER_MODE: "Set_Controller_Mode",
    Command.SET_INPUT_VEL: "Set_Input_Vel",
    Command.CLEAR_ERRORS: "Clear_Errors",
}
"""Names of the messages that only the host sends."""

AXIS_IDLE, AXIS_CLOSED_LOOP, AXIS_STATE_MAX = 1, 8, 14

VELOCITY_MAX: Final = 1e6
"""Greatest speed that is sent [turn/s]; no motor comes near."""

_VELOCITY_CONTROL, _PASSTHROUGH = 2, 1

FLOATS: Final = struct.Struct("<ff")
ERRORS: Final = struct.Struct("<II")
LONG_ERRORS: Final = struct.Struct("<Q")
"""Errors of the motor in 0.5: 64 bits; encoder and controller have 32, the rest is 0."""
HEARTBEATS: Final = struct.Struct("<IBBBB")
"""Error and state of the axis; then in 0.5 flags of motor, encoder and controller, in 0.6 result of
the last procedure, whether a trajectory is done, and nothing."""
_STATE = struct.Struct("<I4x")
_MODE = struct.Struct("<II")
_SDO = struct.Struct("<BHB4s")

CLOSED_LOOP: Final = _STATE.pack(AXIS_CLOSED_LOOP)
IDLE: Final = _STATE.pack(AXIS_IDLE)
VELOCITY_MODE: Final = _MODE.pack(_VELOCITY_CONTROL, _PASSTHROUGH)
STILL: Final = FLOATS.pack(0.0, 0.0)

PROTOCOL_VERSION: Final = 2
"""Version of CANSimple that firmware 0.6 tells."""


class Version(NamedTuple):
    """Answer to Get_Version, which only 0.6 knows."""

    protocol: int
    hardware: tuple[int, int, int]
    firmware: tuple[int, int, int]
    unreleased: int

    def __str__(self) -> str:
        """Return firmware and hardware for people."""
        firmware, hardware = (".".join(map(str, each)) for each in (self.firmware, self.hardware))
        return f"firmware {firmware}{' (unreleased)' if self.unreleased else ''} on {hardware}"


def can_id(node_id: int, command: int) -> int:
    """Return the identifier of a node's message."""
    return node_id << 5 | command


def request_id(node_id: int, command: int) -> int:
    """Return the identifier of the remote request for a node's message."""
    return can_id(node_id, command) | REMOTE_FLAG


def read_version(data: bytes) -> Version:
    """Return what Get_Version says, of 8 bytes."""
    return Version(data[0], (data[1], data[2], data[3]), (data[4], data[5], data[6]), data[7])


def sdo_read(endpoint: int) -> bytes:
    """Return RxSdo that asks for the value of an endpoint."""
    return _SDO.pack(0, endpoint, 0, b"")


def sdo_write(endpoint: int, value: bytes) -> bytes:
    """Return RxSdo that writes a value of up to 4 bytes to an endpoint."""
    return _SDO.pack(1, endpoint, 0, value)


def sdo_content(data: bytes) -> bytes:
    """Return what is said in TxSdo: the endpoint in two bytes, and its value."""
    return data[1:3] + data[4:]


def strange_heartbeat(data: bytes, *, is_old: bool | None) -> str:
    """Say why a heartbeat is none of a firmware; empty: it is one.

    Parameters
    ----------
    data
        The heartbeat.
    is_old
        Whether the firmware is 0.5; None: not known.
    """
    if len(data) != HEARTBEATS.size:
        return f"it has {HEARTBEATS.size} bytes"
    if data[4] > AXIS_STATE_MAX:
        return f"axis state {data[4]} is not 0 to {AXIS_STATE_MAX}"
    # 0.5 has flags in bytes 5 to 7, 0.6 one in byte 6.
    if is_old and (data[5] | data[6] | data[7] & 0x7F) > 1:
        return "bytes 5 to 7 are not the flags of firmware 0.5"
    if is_old is False and data[6] > 1:
        return "byte 6 is not the flag of firmware 0.6"
    return ""
