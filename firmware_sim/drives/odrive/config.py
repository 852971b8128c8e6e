"""The table `[[motor]]` of an ODrive axis, as the simulator reads it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from firmware_sim.config.quantities import closed
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.odrive.settings import Endpoint, ODriveSettings
from firmware_sim.drives.odrive.twin import ODriveTwin
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage


@closed
@dataclass(frozen=True, slots=True)
class ODriveMotor:
    """One axis of an ODrive; `watchdog_endpoints` is the host's, see its documentation."""

    Settings: ClassVar[type] = ODriveSettings

    kind: Literal["odrive"]
    name: str
    axes: tuple[AxisSection]
    node_id: Annotated[int, Field(strict=True, ge=0, le=62)]
    bus: str = ""
    watchdog_endpoints: tuple[Endpoint, ...] = ()

    def make(
        self,
        settings: ODriveSettings,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> Twin:
        """Return the twin."""
        (motor,) = motors
        return ODriveTwin(self.name, self.node_id, settings, motor, stage, run_to, store)
