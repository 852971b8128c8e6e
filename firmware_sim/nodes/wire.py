"""The frames of robot.dbc as the firmware packs and unpacks them.

Written by hand from the DBC, so that a mistake in the generated codec of the other side does not
cancel out here. A protected frame is handled as one 64-bit little-endian integer whose
bits are numbered as in the DBC; bits 0..11 (CRC and counter) belong to `e2e`.

Values beyond a field's range are sent as its nearest value.
"""

from __future__ import annotations

import math
import struct
from typing import Final

import msgspec

PROTOCOL_VERSION: Final = 0x1C76FE73
ENABLE: Final = 0x10
"""Bit of byte 1 of MotorCommand."""
"""CRC-32 (zlib) of the robot.dbc that this module implements: object 0x2001 of the drive."""

NMT: Final = 0x000
EMERGENCY_STOP: Final = 0x001
SYNC: Final = 0x080
EMERGENCY_BASE: Final = 0x080
MOTOR_COMMAND: Final = 0x201
WHEEL_FEEDBACK: Final = 0x181
MOTOR_STATUS: Final = 0x281
DRIVE_STATUS: Final = 0x381
SONAR_RANGES: Final = (0x182, 0x282, 0x382, 0x482)
BATTERY: Final = 0x183
IMU_GYRO: Final = 0x184
IMU_ACCELEROMETER: Final = 0x284
SDO_RESPONSE_BASE: Final = 0x580
SDO_REQUEST_BASE: Final = 0x600
HEARTBEAT_BASE: Final = 0x700

DATA_ID_OFFSET: Final = 0xA000
"""Difference between E2E_DataId and identifier of a frame, except `DATA_ID_EXCEPTIONS`."""
DATA_ID_EXCEPTIONS: Final = {0x382: 0xB382}
"""Exceptions: 0xA382 has the CRC-8 of MotorCommand's 0xA201, so ranges could pass for a command."""

DUTY_RAW_MAX: Final = 10_000
STEERING_RAW_MAX: Final = 15_708

_COMMAND = struct.Struct("<BBhhh")
_EMCY = struct.Struct("<HB5s")


def data_id(arbitration_id: int) -> int:
    """Return the E2E data id of a protected frame."""
    return DATA_ID_EXCEPTIONS.get(arbitration_id, DATA_ID_OFFSET + arbitration_id)


def _raw(value: float, scale: float, low: int, high: int) -> int:
    """Return the nearest raw value of a linear signal (`value` = raw * scale), within its range."""
    steps = value / scale
    if low < steps < high:
        return round(steps)
    return low if steps <= low else high


def _temperature_raw(temperature_c: float) -> int:
    return _raw(temperature_c + 40.0, 1.0, 0, 255)


class MotorCommand(msgspec.Struct, frozen=True, gc=False):
    """RPDO 1: duties in [-1, 1], steering angle [rad], positive left."""

    enable: bool
    brake: bool
    duty1: float
    duty2: float
    steering_rad: float


def motor_command(data: bytes) -> MotorCommand | None:
    """Unpack a checked MotorCommand of eight bytes; None if a value is out of its range."""
    _, flags, duty1, duty2, steering = _COMMAND.unpack(data)
    if not (
        -DUTY_RAW_MAX <= duty1 <= DUTY_RAW_MAX
        and -DUTY_RAW_MAX <= duty2 <= DUTY_RAW_MAX
        and -STEERING_RAW_MAX <= steering <= STEERING_RAW_MAX
    ):
        return None
    return MotorCommand(
        bool(flags & ENABLE), bool(flags & 0x20), duty1 * 1e-4, duty2 * 1e-4, steering * 1e-4
    )


def wheel_feedback(timestamp_us: int, count1: int, count2: int) -> int:
    """Pack TPDO 1 of the drive: time of the latch [us] and both counts, each rolling over."""
    return (
        (timestamp_us & 0xF_FFFF) << 12 | (count1 & 0xFFFF) << 32 | (count2 & 0xFFFF) << 48
    )  # fmt: skip


def motor_status(
    state: int,
    current1_a: float,
    current2_a: float,
    temperature1_c: float,
    temperature2_c: float,
    *,
    faults: int,
) -> int:
    """Pack TPDO 2 of the drive: state 0..15, currents [A], temperatures [degC], six fault bits."""
    return (
        (state & 0xF) << 12
        | (_raw(current1_a, 0.05, -2048, 2047) & 0xFFF) << 16
        | (_raw(current2_a, 0.05, -2048, 2047) & 0xFFF) << 28
        | _temperature_raw(temperature1_c) << 40
        | _temperature_raw(temperature2_c) << 48
        | (faults & 0x3F) << 56
    )


def drive_status(
    echo_counter: int,
    steering_rad: float,
    bus_voltage_v: float,
    command_age_ms: int,
    rejected_commands: int,
) -> int:
    """Pack TPDO 3 of the drive: steering angle [rad], supply [V], the age of the host's commands.

    `command_age_ms` saturates at 255, `rejected_commands` is taken modulo 256.
    """
    return (
        (echo_counter & 0xF) << 12
        | (_raw(steering_rad, 1e-4, -32768, 32767) & 0xFFFF) << 16
        | _raw(bus_voltage_v, 1e-3, 0, 0xFFFF) << 32
        | min(max(command_age_ms, 0), 255) << 48
        | (rejected_commands & 0xFF) << 56
    )


RANGE_NO_ECHO: Final = 8191
RANGE_FAULT: Final = 8190


def range_raw(range_m: float) -> int:
    """Return the raw range [mm]; infinite (or beyond 8.189 m): no echo; nan: fault."""
    if math.isnan(range_m):
        return RANGE_FAULT
    if range_m >= RANGE_FAULT * 1e-3:
        return RANGE_NO_ECHO
    return min(max(round(range_m * 1e3), 0), RANGE_FAULT - 1)


def sonar_ranges(ranges_m: tuple[float, float, float, float]) -> int:
    """Pack the ranges [m] of one group of sonars: inf no echo, nan no such sensor."""
    range0, range1, range2, range3 = ranges_m
    return (
        range_raw(range0) << 12
        | range_raw(range1) << 25
        | range_raw(range2) << 38
        | range_raw(range3) << 51
    )


def battery(
    voltage_v: float, current_a: float, charge: float, temperature_c: float, flags: int
) -> int:
    """Pack TPDO 1 of the battery monitor.

    Parameters
    ----------
    voltage_v, current_a
        Voltage and current at the terminals [V], [A]; positive current discharges.
    charge
        Share of the capacity, [0, 1].
    temperature_c
        Temperature [degC].
    flags
        Bit 0: low, bit 1: critical.
    """
    return (
        (flags & 0x3) << 12
        | _raw(voltage_v, 1e-3, 0, 0xFFFF) << 16
        | (_raw(current_a, 1e-2, -32768, 32767) & 0xFFFF) << 32
        | _raw(charge, 0.005, 0, 200) << 48
        | _temperature_raw(temperature_c) << 56
    )


def imu_gyro(rate_rad_s: tuple[float, float, float]) -> int:
    """Pack TPDO 1 of the IMU: mean rates of turn about x, y, z of the sensor [rad/s]."""
    return _vector(rate_rad_s, 0.0005)


def imu_accelerometer(force_m_s2: tuple[float, float, float]) -> int:
    """Pack TPDO 2 of the IMU: mean specific force along x, y, z of the sensor [m/s^2]."""
    return _vector(force_m_s2, 0.002)


def _vector(values: tuple[float, float, float], scale: float) -> int:
    x, y, z = (_raw(each, scale, -32768, 32767) & 0xFFFF for each in values)
    return x << 16 | y << 32 | z << 48


def emergency(code: int, register: int, detail: bytes = b"") -> bytes:
    """Pack a CiA 301 EMCY: error code, error register, up to five bytes of detail."""
    return _EMCY.pack(code, register, detail)
