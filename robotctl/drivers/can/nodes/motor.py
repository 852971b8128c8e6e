"""Process data of our motor controller, as robot.dbc lays them out."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Final

import msgspec

from robotctl.drivers.can.bus_load import STEERING_STATUS
from robotctl.drivers.can.nodes.can_node import FrameReader, NodeFrame
from robotctl.messages.actuators import DriveState


class DriveFault(enum.IntFlag):
    """Latched faults of the motor controller, in the bit order of MotorStatus."""

    OVER_CURRENT = 1
    OVER_TEMPERATURE = 2
    UNDER_VOLTAGE = 4
    ENCODER = 8
    COMMAND_TIMEOUT = 16
    PARAMETER = 32


_FAULT_SIGNALS: Final = {
    DriveFault.OVER_CURRENT: "FaultOverCurrent",
    DriveFault.OVER_TEMPERATURE: "FaultOverTemperature",
    DriveFault.UNDER_VOLTAGE: "FaultUnderVoltage",
    DriveFault.ENCODER: "FaultEncoder",
    DriveFault.COMMAND_TIMEOUT: "FaultCommandTimeout",
    DriveFault.PARAMETER: "FaultParameter",
}
_STATES: Final = tuple(DriveState)


class WheelFeedback(msgspec.Struct, frozen=True, gc=False):
    """Encoder counts (16 bit, rolling over) and the drive's latch time (20 bit) [us]."""

    stamp_ns: int
    timestamp_us: int
    counts: tuple[int, int]


class MotorStatus(msgspec.Struct, frozen=True, gc=False):
    """State, faults, currents [A, positive for forward torque] and winding temperatures [degC]."""

    stamp_ns: int
    state: DriveState
    faults: int
    currents_a: tuple[float, float]
    temperatures_c: tuple[float, float]


class DriveStatus(msgspec.Struct, frozen=True, gc=False):
    """Steering angle [rad, positive left], supply [V], and the age of the host's commands [ms]."""

    stamp_ns: int
    steering_rad: float
    bus_voltage_v: float
    command_age_ms: int


def read_wheels(reader: FrameReader) -> Callable[[bytes, int], WheelFeedback]:
    """Return the function from data and time of reception [ns] to what WheelFeedback says."""
    decode = reader.decoder("WheelFeedback", "Timestamp", "Count1", "Count2")

    def read(data: bytes, stamp_ns: int) -> WheelFeedback:
        timestamp_us, count1, count2 = decode(data)
        return WheelFeedback(stamp_ns, timestamp_us, (count1, count2))

    return read


def read_motor(reader: FrameReader) -> Callable[[bytes, int], MotorStatus]:
    """Return the function from data and time of reception [ns] to what MotorStatus says."""
    reader.dbc.expect_values("MotorStatus", "State", DriveState)
    decode = reader.decoder(
        "MotorStatus",
        *("State", "Current1", "Current2", "Temperature1", "Temperature2"),
        *_FAULT_SIGNALS.values(),
    )

    def read(data: bytes, stamp_ns: int) -> MotorStatus:
        state, current1_a, current2_a, temperature1_c, temperature2_c, *flags = decode(data)
        return MotorStatus(
            stamp_ns,
            # One that the DBC does not know is taken as a fault.
            _STATES[state] if state < len(_STATES) else DriveState.FAULT,
            _fault_bits(flags),
            (current1_a, current2_a),
            (temperature1_c, temperature2_c),
        )

    return read


def _fault_bits(flags: list[int]) -> int:
    """Return `DriveFault` bits of the six fault signals, in their order."""
    bits = 0
    for fault, flag in zip(_FAULT_SIGNALS, flags, strict=True):
        if flag:
            bits |= fault.value
    return bits


def read_drive(reader: FrameReader) -> Callable[[bytes, int], DriveStatus]:
    """Return the function from data and time of reception [ns] to what DriveStatus says."""
    decode = reader.decoder(STEERING_STATUS, "SteeringAngle", "BusVoltage", "CommandAge")

    def read(data: bytes, stamp_ns: int) -> DriveStatus:
        return DriveStatus(stamp_ns, *decode(data))

    return read


FRAMES: Final = (
    NodeFrame("WheelFeedback", "wheels", read_wheels),
    NodeFrame("MotorStatus", "motor", read_motor),
    NodeFrame(STEERING_STATUS, "drive", read_drive),
)
"""Its process data."""
