"""CANopen node 3: battery monitor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import Protector
from firmware_sim.nodes.node import GENERIC, MILLISECOND_NS, NEVER_NS, NmtState, Node, Trouble
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.standard_objects import (
    pdo_communication,
    pdo_image,
    pdo_mapping,
    standard_objects,
)
from firmware_sim.nodes.variables import Access, DataType, Object, variable

NODE_ID: Final = 3
PERIOD_NS: Final = 100 * MILLISECOND_NS
LOW_LIMIT: Final = 0x2300
CRITICAL_LIMIT: Final = 0x2301
BATTERY_IMAGE: Final = 0x2310
HYSTERESIS_V: Final = 0.2

LOW_MV_PER_CELL: Final = 3500
CRITICAL_MV_PER_CELL: Final = 3200

BATTERY_CRITICAL: Final = Trouble(0x3220, GENERIC | 0x04)
"""DC link under-voltage, CiA 402-2, table 2."""

LOW_FLAG, CRITICAL_FLAG = 0x1, 0x2


class BatterySample(NamedTuple):
    """The battery's terminals: [V], [A] (positive discharges), charge [0, 1], [degC]."""

    voltage_v: float
    current_a: float
    charge: float
    temperature_c: float


def power_objects(cells: int) -> list[Object]:
    """Return all objects of the monitor of a battery of `cells` lithium cells in series."""
    number = DataType.UNSIGNED16
    low_mv, critical_mv = cells * LOW_MV_PER_CELL, cells * CRITICAL_MV_PER_CELL
    return [
        *standard_objects(NODE_ID, "robotctl power", 3),
        pdo_communication(0x1800, "TPDO 1 communication", wire.BATTERY, 254),
        pdo_mapping(0x1A00, "TPDO 1 mapping", BATTERY_IMAGE),
        variable(
            LOW_LIMIT, "Low limit [mV]", number, Access.RW, low_mv,
            low=0, high=0xFFFF, stored=True,
        ),
        variable(
            CRITICAL_LIMIT, "Critical limit [mV]", number, Access.RW, critical_mv,
            low=0, high=0xFFFF, stored=True,
        ),
        pdo_image(BATTERY_IMAGE, "Battery"),
    ]  # fmt: skip


class PowerNode(Node):
    """The battery monitor: a measurement each 100 ms, flags with hysteresis, EMCY when critical.

    Parameters
    ----------
    measure
        Function that takes a sample at a time [ns].
    cells
        Cells in series, for the default limits.
    store
        Non-volatile memory.
    """

    def __init__(
        self,
        measure: Callable[[int], BatterySample],
        cells: int,
        store: ParameterStore | None = None,
    ) -> None:
        self._measure = measure
        self._protector = Protector(wire.data_id(wire.BATTERY))
        self._measure_ns = NEVER_NS
        self._flags = 0
        super().__init__(NODE_ID, "power", ObjectDictionary(power_objects(cells)), store)

    def _on_power_up(self) -> None:
        self._protector.reset()
        self._flags = 0
        self._measure_ns = NEVER_NS

    def _on_nmt_change(self) -> None:
        operational = self.state is NmtState.OPERATIONAL
        self._measure_ns = self._now_ns + self.clock.span_ns(PERIOD_NS) if operational else NEVER_NS

    def _due_ns(self) -> int:
        return self._measure_ns

    def _step(self, now_ns: int) -> None:
        if now_ns < self._measure_ns:
            return
        self._measure_ns += self.clock.span_ns(PERIOD_NS)
        sample = self._measure(now_ns)
        flags = self._judge(LOW_FLAG, LOW_LIMIT, sample.voltage_v)
        flags |= self._judge(CRITICAL_FLAG, CRITICAL_LIMIT, sample.voltage_v)
        self._flags = flags
        if flags & CRITICAL_FLAG:
            self.report(BATTERY_CRITICAL)
        else:
            self.retract(BATTERY_CRITICAL)
        payload = self._protector.protect(wire.battery(*sample, flags))
        self.send_image(wire.BATTERY, BATTERY_IMAGE, payload)

    def _judge(self, flag: int, limit: int, voltage_v: float) -> int:
        limit_v = self.dictionary.number(limit) * 1e-3
        if self._flags & flag:
            limit_v += HYSTERESIS_V
        return flag if voltage_v < limit_v else 0
