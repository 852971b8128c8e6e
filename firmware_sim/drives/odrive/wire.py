"""Messages of CANSimple as an ODrive sees them.

Sources: DBC files of firmware 0.5.6 and 0.6.10 in the package odrive-can 2.1.0; for 0.5
odriverobotics/ODrive, Firmware/communication/can/can_simple.cpp.
"""

from __future__ import annotations

import struct
from typing import Final

NODE_SHIFT: Final = 5
FIRST_06: Final = (0, 6, 0)
"""First firmware of series 0.6."""

VERSION: Final = 0x00
HEARTBEAT: Final = 0x01
ESTOP: Final = 0x02
MOTOR_ERROR = ERROR = 0x03
ENCODER_ERROR = RX_SDO = 0x04
SENSORLESS_ERROR = TX_SDO = 0x05
SET_AXIS_STATE: Final = 0x07
ENCODER_ESTIMATES: Final = 0x09
ENCODER_COUNT: Final = 0x0A
SET_CONTROLLER_MODE: Final = 0x0B
SET_INPUT_POS: Final = 0x0C
SET_INPUT_VEL: Final = 0x0D
SET_INPUT_TORQUE: Final = 0x0E
SET_LIMITS: Final = 0x0F
IQ: Final = 0x14
SENSORLESS_ESTIMATES = TEMPERATURE = 0x15
REBOOT: Final = 0x16
BUS_VOLTAGE_CURRENT: Final = 0x17
CLEAR_ERRORS: Final = 0x18
CONTROLLER_ERROR = POWERS = 0x1D

COMMANDS: Final = range(1 << NODE_SHIFT)
EXCHANGED: Final = (
    VERSION, HEARTBEAT, ESTOP, ERROR, RX_SDO, TX_SDO, SET_AXIS_STATE, ENCODER_ESTIMATES,
    SET_CONTROLLER_MODE, SET_INPUT_VEL, SET_LIMITS, IQ, TEMPERATURE, BUS_VOLTAGE_CURRENT,
    CLEAR_ERRORS,
)  # fmt: skip
"""Commands between an axis and its host."""

PROTOCOL_VERSION: Final = 2

UNDEFINED, IDLE, STARTUP, CLOSED_LOOP = 0, 1, 2, 8
TORQUE_CONTROL, VELOCITY_CONTROL, POSITION_CONTROL = 1, 2, 3
PASSTHROUGH, VEL_RAMP = 1, 2
WRITE: Final = 1
"""Opcode of RxSdo; 0 reads."""
SAVE, ERASE = 1, 2
"""Actions of Reboot; 0 only reboots."""

SUCCESS, BUSY, CANCELLED, DISARMED, NOT_CALIBRATED = 0, 1, 2, 3, 14
"""Results of a procedure, in 0.6."""

UINT32 = struct.Struct("<I")
UINT64 = struct.Struct("<Q")
FLOAT = struct.Struct("<f")
TWO_UINT32 = struct.Struct("<II")
TWO_INT32 = struct.Struct("<ii")
TWO_FLOATS = struct.Struct("<ff")
HEARTBEATS = struct.Struct("<IBBBB")
SDO = struct.Struct("<BHB")
