"""The table `[[motor]]` of a VESC, as the simulator reads it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

from firmware_sim.bus.frame import EXTENDED_FLAG
from firmware_sim.config.quantities import NotNegative, Positive, Share, closed
from firmware_sim.drives.config import AxisSection, Guard
from firmware_sim.drives.twin import Motor
from firmware_sim.drives.vesc.settings import Milliseconds, VescSettings
from firmware_sim.drives.vesc.twin import (
    HOST_COMMANDS,
    STATUS_COMMANDS,
    Fitting,
    ServoOutput,
    VescTwin,
)
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage

Number: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=254)]
PolePairs: TypeAlias = Annotated[int, Field(strict=True, ge=1, le=100)]

SERVO_AXIS = 2


@closed
@dataclass(frozen=True, slots=True)
class VescServoSection:
    """Servo at the servo output."""

    centre: Share = 0.5
    range_deg: Positive = 90.0
    rate_deg_s: Positive = 350.0


@closed
@dataclass(frozen=True, slots=True)
class VescMotor:
    """One VESC."""

    kind: Literal["vesc"]
    name: str
    axes: tuple[AxisSection, ...]
    bus: str = ""
    node_id: Number = 0
    pole_pairs: PolePairs = 7
    brake_current_a: NotNegative = 0.0
    accept_coasting: bool = False
    accept_timeout_ms: Milliseconds = 0
    handbrake_current_a: NotNegative = 0.0
    motor_temperature: bool = False
    status_rate_hz: Annotated[int, Field(strict=True, ge=10, le=1000)] = 200
    servo: VescServoSection = VescServoSection()

    Settings: ClassVar[type] = VescSettings
    FAULT_CODES: ClassVar[range] = range(1, 1 << 8)

    @property
    def frames(self) -> tuple[int, ...]:
        """Identifiers of its frames and of the host's frames to it."""
        commands = (*STATUS_COMMANDS.values(), *HOST_COMMANDS)
        return tuple(EXTENDED_FLAG | command << 8 | self.node_id for command in commands)

    def guards(self, _settings: VescSettings) -> frozenset[Guard]:
        """Return the dangers against which it guards itself."""
        return frozenset(Guard)

    def make(
        self,
        settings: VescSettings,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> VescTwin:
        """Return the twin; `motors` has the one motor of its wheel."""
        joints = [axis for axis in self.axes if axis.axis == SERVO_AXIS]
        servo = None
        if joints:
            servo = ServoOutput(self.servo.centre, self.servo.range_deg, joints[0].motor_per_wheel)
        (motor,) = (axis for axis in self.axes if axis.axis != SERVO_AXIS)
        fitting = Fitting(self.node_id, self.pole_pairs, motor.ratio, self.status_rate_hz)
        return VescTwin(self.name, fitting, settings, motors[0], servo, stage, run_to, store)
