"""Node 2, the sonar ring: up to 16 ranges, in frames of four."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
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
    expect,
    identify,
    same_wire,
)
from robotctl.drivers.can.nodes.sdo import Request
from robotctl.messages.control import SonarFeedback
from robotctl.messages.faults import FaultCode
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig


def sonar_script(dbc: Dbc, parameters: NodeParameters) -> Callable[[], Script]:
    """Return the script of the sonar ring: identity, number of sonars, ring period of the DBC."""
    period_ms = dbc.message("SonarRangesA").cycle_ms
    ring_period = Setting(0x2201, 0, "ring period", period_ms, 2, " ms")

    def script() -> Script:
        return (
            (yield from identify(Product.SONAR_RING))
            or (yield from same_wire(dbc.wire_version, optional=True))
            or (
                yield from expect(
                    Request(0x2200, 0, "number of sonars"),
                    parameters.sonars,
                    "has {found} sonars, the configuration says {wanted}",
                )
            )
            or (yield from configure_and_start(ring_period, HEARTBEAT))
        )

    return script


def _read_ranges(
    message: str, first: int, reader: FrameReader
) -> Callable[[bytes, int], SonarFeedback]:
    """Read ranges [m] of sonars `first` on: inf no echo, nan no sensor or a fault."""
    names = [f"Range{first + offset}" for offset in range(4)]
    decode = reader.decoder(message, *names, raw=names)
    scale = reader.dbc.signal(message, names[0]).scale
    special = {
        reader.dbc.value(message, names[0], "no_echo"): math.inf,
        reader.dbc.value(message, names[0], "fault"): math.nan,
    }

    def read(data: bytes, stamp_ns: int) -> SonarFeedback:
        a, b, c, d = decode(data)
        ranges_m = (
            special[a] if a in special else a * scale,
            special[b] if b in special else b * scale,
            special[c] if c in special else c * scale,
            special[d] if d in special else d * scale,
        )
        return SonarFeedback(stamp_ns, first, ranges_m)

    return read


def _ages(safety: SafetyConfig, _: int) -> tuple[AgeLimit, ...]:
    limit_ns = safety.sonar_timeout_ms * 1_000_000
    return (AgeLimit("sonars", FaultCode.SONAR_STALE, "has given no range for", "", limit_ns),)


SONAR: Final = CanNode(
    node_id=2,
    name="sonar",
    script=sonar_script,
    frames=tuple(
        NodeFrame(message, "sonars", partial(_read_ranges, message, 4 * group))
        for group, message in enumerate(
            ("SonarRangesA", "SonarRangesB", "SonarRangesC", "SonarRangesD")
        )
    ),
    ages=_ages,
    is_wanted=lambda parameters: parameters.sonars > 0,
)
