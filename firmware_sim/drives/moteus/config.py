"""The table `[[motor]]` of a moteus, and the true drive behind it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from firmware_sim.config.quantities import closed
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.moteus.settings import MoteusSettings
from firmware_sim.drives.moteus.twin import MoteusTwin
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

    def make(
        self,
        settings: MoteusSettings,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> MoteusTwin:
        """Return the drive."""
        ratio = self.axes[0].ratio
        return MoteusTwin(self.name, self.node_id, settings, motors[0], ratio, stage, run_to, store)
