"""Node 3, the battery monitor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import Dbc
from robotctl.drivers.can.nodes.can_node import CanNode, FrameReader, NodeFrame
from robotctl.drivers.can.nodes.commissioning import (
    HEARTBEAT,
    Product,
    Script,
    Setting,
    configure_and_start,
    identify,
    same_wire,
)
from robotctl.messages.control import BatteryFeedback
from robotctl.messages.faults import FaultCode
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig


def power_script(dbc: Dbc, _: NodeParameters) -> Callable[[], Script]:
    """Return the script of the battery monitor: identity, heartbeat, its limits."""
    limits = (
        Setting(0x2300, 0, "low limit", None, 2, " mV"),
        Setting(0x2301, 0, "critical limit", None, 2, " mV"),
    )

    def script() -> Script:
        return (
            (yield from identify(Product.POWER))
            or (yield from same_wire(dbc.wire_version, optional=True))
            or (yield from configure_and_start(HEARTBEAT, *limits))
        )

    return script


def _read_battery(reader: FrameReader) -> Callable[[bytes, int], BatteryFeedback]:
    decode = reader.decoder(
        "Battery",
        *("Voltage", "Current", "Charge", "Temperature", "BatteryLow", "BatteryCritical"),
    )

    def read(data: bytes, stamp_ns: int) -> BatteryFeedback:
        voltage, current, charge, temperature, low, critical = decode(data)
        return BatteryFeedback(
            stamp_ns, voltage, current, charge / 100, temperature, bool(low), bool(critical)
        )

    return read


def _ages(safety: SafetyConfig, _: int) -> tuple[AgeLimit, ...]:
    limit_ns = safety.battery_timeout_ms * 1_000_000
    return (AgeLimit("battery", FaultCode.BATTERY_STALE, "the battery's report is", "", limit_ns),)


POWER: Final = CanNode(
    node_id=3,
    name="power",
    script=power_script,
    frames=(NodeFrame("Battery", "battery", _read_battery),),
    ages=_ages,
    is_wanted=lambda parameters: parameters.power.source == "node",
)
