"""Commissioning of our motor controller: what is checked, written and kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.bus_load import STEERING_STATUS, SYNC, transmission_type
from robotctl.drivers.can.dbc import Dbc
from robotctl.drivers.can.nodes.commissioning import (
    HEARTBEAT,
    Product,
    Script,
    Setting,
    configure_and_start,
    expect,
    identify,
    same_wire,
)
from robotctl.drivers.can.nodes.sdo import Request

COUNTS_DIFFER: Final = "has {found} counts per revolution, the configuration says {wanted}"
CLEAR_FAULTS: Final = Request(0x2010, 0, "clear faults", value=1, size=1)


def drive_script(
    dbc: Dbc, rate_hz: int, command_timeout_ms: int, counts_per_revolution: int, *, steered: bool
) -> Callable[[], Script]:
    """Return the script of the motor controller.

    Identity, wire version, counts per revolution; then the command time-out and how often the
    status frames come; its heartbeat and its own limits as they are.
    """
    sync = dbc.message(SYNC)
    motor_every, drive_every = (
        transmission_type(dbc.message(name), sync, rate_hz, steered=steered)
        for name in ("MotorStatus", STEERING_STATUS)
    )
    settings = (
        Setting(0x2000, 0, "command time-out", command_timeout_ms, 2, " ms"),
        Setting(0x1801, 2, "period of MotorStatus", motor_every, 1, " SYNC"),
        Setting(0x1802, 2, "period of DriveStatus", drive_every, 1, " SYNC"),
        HEARTBEAT,
        Setting(0x2003, 0, "current limit", None, 4, " mA"),
        Setting(0x2004, 0, "over-temperature limit", None, 1, " degC"),
        Setting(0x2005, 0, "under-voltage limit", None, 2, " mV"),
    )

    def script() -> Script:
        return (
            (yield from identify(Product.MOTOR_CONTROLLER))
            or (yield from same_wire(dbc.wire_version))
            or (
                yield from expect(
                    Request(0x2002, 0, "counts per revolution"),
                    counts_per_revolution,
                    COUNTS_DIFFER,
                )
            )
            or (yield from configure_and_start(*settings))
        )

    return script
