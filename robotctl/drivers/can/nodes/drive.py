"""Node 1, the motor controller: counts on every SYNC, state of the motors, steering and supply."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.bus_load import STEERING_STATUS, SYNC, transmission_type
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import Dbc
from robotctl.drivers.can.drives.native.wire import read_drive, read_motor, read_wheels
from robotctl.drivers.can.nodes.can_node import CanNode, NodeFrame
from robotctl.drivers.can.nodes.commissioning import (
    HEARTBEAT,
    Script,
    Setting,
    configure_and_start,
    expect,
    identify,
    same_wire,
)
from robotctl.drivers.can.nodes.sdo import Request
from robotctl.messages.faults import FaultCode
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

PRODUCT: Final = 1
CLEAR_FAULTS: Final = Request(0x2010, 0, "clear faults", value=1, size=1)


def drive_script(dbc: Dbc, parameters: NodeParameters) -> Callable[[], Script]:
    """Return the script of the motor controller.

    Identity, wire version, counts per revolution; then the command time-out and how often the
    status frames come; its heartbeat and its own limits as they are.
    """
    sync = dbc.message(SYNC)
    motor_every, drive_every = (
        transmission_type(dbc.message(name), sync, parameters.rate_hz, steered=parameters.steered)
        for name in ("MotorStatus", STEERING_STATUS)
    )
    settings = (
        Setting(0x2000, 0, "command time-out", parameters.command_timeout_ms, 2, " ms"),
        Setting(0x1801, 2, "period of MotorStatus", motor_every, 1, " SYNC"),
        Setting(0x1802, 2, "period of DriveStatus", drive_every, 1, " SYNC"),
        HEARTBEAT,
        Setting(0x2003, 0, "current limit", None, 4, " mA"),
        Setting(0x2004, 0, "over-temperature limit", None, 1, " degC"),
        Setting(0x2005, 0, "under-voltage limit", None, 2, " mV"),
    )

    def script() -> Script:
        counts = parameters.counts_per_revolution
        return (
            (yield from identify(PRODUCT))
            or (yield from same_wire(dbc.wire_version))
            or (
                yield from expect(
                    Request(0x2002, 0, "counts per revolution"),
                    counts,
                    "has {found} counts per revolution, the configuration says {wanted}",
                )
            )
            or (yield from configure_and_start(*settings))
        )

    return script


def _ages(safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
    wheels_ns = safety.feedback_timeout_periods * period_ns
    status_ns = safety.status_timeout_ms * 1_000_000
    return (
        AgeLimit("motion", FaultCode.WHEELS_STALE, "wheel feedback is", "drive", wheels_ns),
        AgeLimit("report", FaultCode.MOTOR_STALE, "motor status is", "drive", status_ns),
        AgeLimit("supply", FaultCode.DRIVE_STALE, "drive status is", "drive", status_ns),
    )


DRIVE: Final = CanNode(
    node_id=1,
    name="drive",
    script=drive_script,
    frames=(
        NodeFrame("WheelFeedback", "wheels", read_wheels),
        NodeFrame("MotorStatus", "motor", read_motor),
        NodeFrame(STEERING_STATUS, "drive", read_drive),
    ),
    ages=_ages,
)
