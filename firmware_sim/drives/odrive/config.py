"""The table `[[motor]]` of an ODrive axis, as the simulator reads it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from firmware_sim.config.quantities import closed
from firmware_sim.drives.config import AxisSection, Guard
from firmware_sim.drives.odrive import wire
from firmware_sim.drives.odrive.settings import Endpoint, ODriveSettings
from firmware_sim.drives.odrive.twin import ODriveTwin
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage


@closed
@dataclass(frozen=True, slots=True)
class ODriveMotor:
    """One axis of an ODrive; only the host uses `watchdog_endpoints`."""

    Settings: ClassVar[type] = ODriveSettings

    kind: Literal["odrive"]
    name: str
    axes: tuple[AxisSection]
    node_id: Annotated[int, Field(strict=True, ge=0, le=62)]
    bus: str = ""
    watchdog_endpoints: tuple[Endpoint, ...] = ()

    FAULT_CODES: ClassVar[range] = range(1, 1 << 32)

    @property
    def frames(self) -> tuple[int, ...]:
        """Identifiers of its frames and of the host's frames to it."""
        return tuple(self.node_id << wire.NODE_SHIFT | command for command in wire.EXCHANGED)

    def guards(self, settings: ODriveSettings) -> frozenset[Guard]:
        """Return the dangers against which it guards itself."""
        heat = {Guard.HEAT} if settings.motor_thermistor else set()
        return frozenset({Guard.CURRENT} | heat)

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
