"""The table `[[motor]]` of a CiA 402 drive, as the simulator reads it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from firmware_sim.config.motors import AxisSection
from firmware_sim.config.quantities import closed
from firmware_sim.drives.cia402.axes import Units
from firmware_sim.drives.cia402.objects import RPDO_BASES, TPDO_BASES
from firmware_sim.drives.cia402.settings import Cia402Settings, Counts, NodeId
from firmware_sim.drives.cia402.twin import (
    EMERGENCY_BASE,
    HEARTBEAT_BASE,
    SDO_REQUEST_BASE,
    SDO_RESPONSE_BASE,
    Cia402Twin,
)
from firmware_sim.drives.config import Guard
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage, UnfittedAxis

_ZLAC_COUNTS = 4096


@closed
@dataclass(frozen=True, slots=True)
class Cia402Motor:
    """A drive of CiA 402 over CANopen; the keys are those of robotctl."""

    Settings: ClassVar = Cia402Settings
    FAULT_CODES: ClassVar[range] = range(1, 1 << 16)

    kind: Literal["cia402"]
    name: str
    axes: tuple[AxisSection, ...]
    node_id: NodeId
    bus: str = ""
    dialect: Literal["generic", "zlac8015d", "roboteq"] = "generic"
    eds: str = ""
    mode: Literal["profile_velocity", "velocity"] = "profile_velocity"
    counts_per_turn: Counts = 0
    speed_unit: Literal["counts/s", "rpm", "0.1 rpm"] = "counts/s"
    host_id: NodeId = 127
    accept_coasting: bool = False

    @property
    def frames(self) -> tuple[int, ...]:
        """Identifiers of its frames and of the host's frames to it."""
        services = EMERGENCY_BASE, SDO_RESPONSE_BASE, SDO_REQUEST_BASE, HEARTBEAT_BASE
        own = (base + self.node_id for base in (*RPDO_BASES, *TPDO_BASES, *services))
        return (*own, HEARTBEAT_BASE + self.host_id)

    def guards(self, _settings: Cia402Settings) -> frozenset[Guard]:
        """Return the dangers against which it guards itself."""
        return frozenset(Guard)

    def make(
        self,
        settings: Cia402Settings,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> Twin:
        """Return the twin; `motors` are in the order of `axes`."""
        unfitted = Motor(UnfittedAxis(25.0), 1.0)
        count = max(2 if self.dialect == "zlac8015d" else 1, *(axis.axis for axis in self.axes))
        shafts, ratios = [unfitted] * count, [1.0] * count
        for axis, motor in zip(self.axes, motors, strict=True):
            shafts[axis.axis - 1], ratios[axis.axis - 1] = motor, axis.ratio
        return Cia402Twin(
            self.name,
            self.dialect,
            settings.node_id or self.node_id,
            self._units(settings),
            shafts,
            ratios,
            settings,
            stage,
            run_to,
            store,
        )

    def _units(self, settings: Cia402Settings) -> Units:
        """Return the true units of the drive."""
        zlac = self.dialect == "zlac8015d"
        told = self.counts_per_turn or (_ZLAC_COUNTS if zlac else 0)
        counts = settings.counts_per_turn or told
        rpm = 60.0 / (2.0 * math.pi)
        if zlac:
            return Units(counts, rpm, 10.0 * rpm)
        unit = {"counts/s": counts / (2.0 * math.pi), "rpm": rpm, "0.1 rpm": 10.0 * rpm}
        speed = rpm if self.dialect == "roboteq" else unit[self.speed_unit]
        return Units(counts, speed, speed)
