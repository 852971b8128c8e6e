"""ESC_INFO, ESC_STATUS, DEBUG_FLOAT_ARRAY and SERVO_OUTPUT_RAW: the motor controllers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, TypeVar

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState
from robotctl.messages.mavlink_port import Message

T = TypeVar("T")

A_MESSAGE: Final = 4
"""Controllers in one message."""
MOST_VALUES: Final = 58
"""Maximum values of DEBUG_FLOAT_ARRAY."""
OUTPUTS: Final = 8
"""Outputs of SERVO_OUTPUT_RAW; those that drive nothing are 0."""
_RPM: Final = 60.0 / math.tau


class MotorControllers(Microservice):
    """Sends what the controllers of the driven wheels measure, on request."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._sent = 0

    def streams(self) -> tuple[Stream, ...]:
        """Return the messages, which are off."""
        info, status = additions.MAVLINK_MSG_ID_ESC_INFO, additions.MAVLINK_MSG_ID_ESC_STATUS
        return (
            Stream(info, self._info, 0.0),
            Stream(status, self._status, 0.0),
            Stream(common.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY, self._loops, 0.0),
            Stream(
                common.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
                self._pulses,
                0.0,
                common.MAV_DATA_STREAM_RC_CHANNELS,
            ),
        )

    def _info(self, now_ns: int) -> list[Message]:
        """Return ESC_INFO: the controllers that answer, and their temperatures [cdegC]."""
        control = self._context.fresh_control(now_ns)
        if control is None:
            return []
        self._sent += 1
        messages = []
        for first, places in _fours(len(control.wheel_rad_s)):
            degrees = [control.temperature_c[place] for place in places]
            heard = [control.wheel_rad_s[place] for place in places]
            messages.append(
                additions.MAVLink_esc_info_message(
                    first,
                    frames.boot_us(control.stamp_ns),
                    self._sent & 0xFFFF,
                    len(control.wheel_rad_s),
                    additions.ESC_CONNECTION_TYPE_CAN,
                    sum(1 << k for k, rad_s in enumerate(heard) if math.isfinite(rad_s)),
                    [0] * A_MESSAGE,
                    [0] * A_MESSAGE,
                    _four([frames.centidegrees_celsius(each) for each in degrees], 0),
                )
            )
        return messages

    def _status(self, now_ns: int) -> list[Message]:
        """Return ESC_STATUS: speed of the wheel, voltage of the bus, current of the motor."""
        control = self._context.fresh_control(now_ns)
        if control is None:
            return []
        return [
            additions.MAVLink_esc_status_message(
                first,
                frames.boot_us(control.stamp_ns),
                _four([_rpm(control.wheel_rad_s[place]) for place in places], 0),
                _four([control.bus_voltage_v] * len(places), 0.0),
                _four([control.current_a[place] for place in places], 0.0),
            )
            for first, places in _fours(len(control.wheel_rad_s))
        ]

    def _pulses(self, now_ns: int) -> list[Message]:
        """Return SERVO_OUTPUT_RAW: the duty of each wheel as the pulse of DO_MOTOR_TEST [us]."""
        control = self._context.fresh_control(now_ns)
        if control is None:
            return []
        pulses = [_pulse_us(duty) for duty in control.duty[:OUTPUTS]]
        return [
            common.MAVLink_servo_output_raw_message(
                frames.boot_us(control.stamp_ns) & frames.UINT32_MAX,
                0,
                *pulses,
                *[0] * (OUTPUTS - len(pulses)),
            )
        ]

    def _loops(self, now_ns: int) -> list[Message]:
        """Return DEBUG_FLOAT_ARRAY: wanted and measured speed [rad/s] and duty of each wheel."""
        control = self._context.fresh_control(now_ns)
        if control is None:
            return []
        values = [value for wheel in _wheels(control) for value in wheel][:MOST_VALUES]
        values += [0.0] * (MOST_VALUES - len(values))
        return [
            common.MAVLink_debug_float_array_message(
                frames.boot_us(control.stamp_ns), b"wheels", 0, values
            )
        ]


def _wheels(control: ControlState) -> Iterator[tuple[float, float, float]]:
    return zip(control.wheel_ref_rad_s, control.wheel_rad_s, control.duty, strict=True)


def _fours(count: int) -> Iterator[tuple[int, range]]:
    """Yield the first place and all places of each message."""
    for first in range(0, count, A_MESSAGE):
        yield first, range(first, min(first + A_MESSAGE, count))


def _four(values: Sequence[T], unused: T) -> list[T]:
    return [*values, *[unused] * (A_MESSAGE - len(values))]


def _rpm(rad_s: float) -> int:
    """Return a speed that fits; 0 where it is not known, which ESC_INFO says."""
    return round(rad_s * _RPM) if frames.fit(rad_s * _RPM) and abs(rad_s) < 1e8 else 0


def _pulse_us(duty: float) -> int:
    return round(1500.0 + 500.0 * max(-1.0, min(duty, 1.0))) if math.isfinite(duty) else 0
