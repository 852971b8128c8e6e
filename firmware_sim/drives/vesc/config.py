"""The table `[[motor]]` of a VESC, and the true drive behind it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

from firmware_sim.config.quantities import NotNegative, Positive, Share, closed
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.twin import Motor
from firmware_sim.drives.vesc.twin import Firmware, ServoOutput, VescTwin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage

Number: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=254)]
PolePairs: TypeAlias = Annotated[int, Field(strict=True, ge=1, le=100)]
Milliseconds: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=60_000)]

SERVO_AXIS = 2


@closed
@dataclass(frozen=True, slots=True)
class VescServoSection:
    """Servo at the output."""

    centre: Share = 0.5
    range_deg: Positive = 90.0
    rate_deg_s: Positive = 350.0


@closed
@dataclass(frozen=True, slots=True)
class VescSettings:
    """The table `[simulation.twin.NAME]`: the drive as it left VESC Tool.

    Attributes
    ----------
    firmware
        Major and minor version.
    stored_timeout_ms, stored_brake_current_a
        Settings for a silent host in its flash.
    status
        Which are sent, by their numbers.
    min_erpm
        The speed loop lets go below this.
    max_erpm, ramp_erpm_s
        Limits of the speed loop.
    current_a, absolute_current_a
        Limit of the motor's current, and of the fault.
    fault_stop_ms
        Time that a fault lasts.
    boot_ms
        From power to the first frame.
    notifies_boot
        Whether it sends NOTIFY_BOOT.
    sets_timeout
        Whether it knows COMM_SET_APPCONF_NO_STORE.
    tells_flags
        Whether it tells time-out and kill switch in COMM_GET_VALUES_SELECTIVE.
    servo_output
        Whether that is enabled.
    """

    firmware: tuple[int, int] = (6, 5)
    stored_timeout_ms: Milliseconds = 1000
    stored_brake_current_a: NotNegative = 0.0
    status: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    min_erpm: NotNegative = 0.0
    max_erpm: Positive = 100_000.0
    ramp_erpm_s: Positive = 25_000.0
    current_a: Positive = 60.0
    absolute_current_a: Positive = 150.0
    fault_stop_ms: Milliseconds = 500
    boot_ms: Milliseconds = 150
    notifies_boot: bool = True
    sets_timeout: bool = True
    tells_flags: bool = True
    servo_output: bool = True


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

    Settings: ClassVar = VescSettings

    def make(
        self,
        settings: VescSettings,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> VescTwin:
        """Return the drive; `motors` are those of its wheels, so that there is one."""
        joints = [axis for axis in self.axes if axis.axis == SERVO_AXIS]
        servo = None
        if joints:
            servo = ServoOutput(self.servo.centre, self.servo.range_deg, joints[0].motor_per_wheel)
        firmware = Firmware(
            number=self.node_id,
            ratio=next(axis.ratio for axis in self.axes if axis.axis != SERVO_AXIS),
            pole_pairs=self.pole_pairs,
            version=settings.firmware,
            timeout_ms=settings.stored_timeout_ms,
            brake_current_a=settings.stored_brake_current_a,
            status_rate_hz=self.status_rate_hz,
            status=settings.status,
            min_erpm=settings.min_erpm,
            max_erpm=settings.max_erpm,
            ramp_erpm_s=settings.ramp_erpm_s,
            current_a=settings.current_a,
            absolute_current_a=settings.absolute_current_a,
            fault_stop_ms=settings.fault_stop_ms,
            boot_ms=settings.boot_ms,
            notifies_boot=settings.notifies_boot,
            sets_timeout=settings.sets_timeout,
            tells_flags=settings.tells_flags,
            servo_output=settings.servo_output,
        )
        return VescTwin(self.name, firmware, motors[0], servo, stage, run_to, store)
