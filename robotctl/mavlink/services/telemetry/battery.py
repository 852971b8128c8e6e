"""BATTERY_STATUS: voltage, current and charge; BATTERY_INFO on request: there is a battery."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink import frames
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState
from robotctl.messages.mavlink_port import Message

_UINT8_MAX: Final = 255
"""Health that is not known."""
_LETTERS: Final = 50
"""Maximum length of a name in BATTERY_INFO."""
_OTHER_CELLS = [frames.UINT16_MAX] * 9


class Battery(Microservice):
    """Sends the battery state while control publishes."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message with its configured rate."""
        rate_hz = self._context.config.rates.battery_hz
        return (
            Stream(
                common.MAVLINK_MSG_ID_BATTERY_STATUS,
                self._build,
                rate_hz,
                common.MAV_DATA_STREAM_EXTRA3,
            ),
            Stream(additions.MAVLINK_MSG_ID_BATTERY_INFO, self._build_info, 0.0),
        )

    def _build(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None else battery_status(control)

    def _build_info(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        name = f"battery of {self._context.robot.name}"
        return [] if control is None or control.battery is None else [battery_info(name)]


def battery_info(name: str) -> Message:
    """Return BATTERY_INFO: which battery it is and what it powers; no robot's file says more."""
    unknown_v = unknown_a = unknown_ah = 0.0
    return additions.MAVLink_battery_info_message(
        0,
        common.MAV_BATTERY_FUNCTION_ALL,
        common.MAV_BATTERY_TYPE_UNKNOWN,
        _UINT8_MAX,  # health
        0,
        frames.UINT16_MAX,  # cycles
        0,
        *(unknown_v,) * 4,
        unknown_a,
        unknown_v,
        *(unknown_a,) * 2,
        *(unknown_ah,) * 2,
        b"",
        b"",
        name.encode("ascii", "replace")[:_LETTERS],
    )


def battery_status(state: ControlState) -> list[Message]:
    """Return BATTERY_STATUS; empty without battery data."""
    battery = state.battery
    if battery is None:
        return []
    charge_state = common.MAV_BATTERY_CHARGE_STATE_OK
    if battery.critical:
        charge_state = common.MAV_BATTERY_CHARGE_STATE_CRITICAL
    elif battery.low:
        charge_state = common.MAV_BATTERY_CHARGE_STATE_LOW
    return [
        common.MAVLink_battery_status_message(
            0,
            common.MAV_BATTERY_FUNCTION_ALL,
            common.MAV_BATTERY_TYPE_UNKNOWN,
            frames.centidegrees_celsius(battery.temperature_c),
            [frames.millivolts(battery.voltage_v), *_OTHER_CELLS],
            frames.centiamperes(battery.current_a),
            -1,  # consumed charge and energy are not measured
            -1,
            frames.percent(battery.charge),
            0,
            charge_state,
        )
    ]
