"""The table `[[motor]]` of a moteus, as the simulator reads it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from firmware_sim.bus.frame import EXTENDED_FLAG, FD_FLAG, STANDARD_MASK
from firmware_sim.config.quantities import closed
from firmware_sim.drives.config import AxisSection, Guard
from firmware_sim.drives.moteus.settings import MoteusSettings
from firmware_sim.drives.moteus.twin import REPLIES, MoteusTwin
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage


@closed
@dataclass(frozen=True, slots=True)
class MoteusMotor:
    """One moteus."""

    kind: Literal["moteus"]
    name: str
    axes: tuple[AxisSection, ...]
    bus: str = ""
    node_id: Annotated[int, Field(strict=True, ge=1, le=126)] = 1
    accept_coasting: bool = False

    Settings: ClassVar[type] = MoteusSettings
    FAULT_CODES: ClassVar[range] = range(32, 1 << 7)

    @property
    def frames(self) -> tuple[int, ...]:
        """Identifiers of its answers, and of a host with number 0 that asks for them."""
        plain = REPLIES << 8 | self.node_id, self.node_id << 8
        return tuple(
            FD_FLAG | each | (EXTENDED_FLAG if each > STANDARD_MASK else 0) for each in plain
        )

    def guards(self, _settings: MoteusSettings) -> frozenset[Guard]:
        """Return the dangers against which it guards itself; it only limits over-current."""
        return frozenset({Guard.HEAT})

    def make(
        self,
        settings: MoteusSettings,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> MoteusTwin:
        """Return the twin."""
        ratio = self.axes[0].ratio
        return MoteusTwin(self.name, self.node_id, settings, motors[0], ratio, stage, run_to, store)
