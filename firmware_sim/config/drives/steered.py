"""One driven wheel or axle, and a steered front."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

from firmware_sim.config.drives.chassis import (
    FORWARD,
    GRAVITY_M_S2,
    LEFT,
    Chassis,
    Drag,
    Grip,
    Steering,
    Wheel,
    tips_over,
    true_radii,
)
from firmware_sim.config.quantities import Counts, Positive, Real, closed

if TYPE_CHECKING:
    from firmware_sim.config.parameters import SimulationParameters

SteeringMax: TypeAlias = Annotated[float, Field(strict=True, gt=0, lt=math.pi / 2)]


@closed
@dataclass(frozen=True, slots=True)
class TricycleDrive:
    """One steered front wheel, two rear wheels; one motor, at the front wheel or the rear axle."""

    wheel_names: ClassVar = ("drive",)

    kind: Literal["tricycle"]
    driven: Literal["front", "rear"]
    wheelbase_m: Positive
    wheel_radius_m: Positive
    steering_max_rad: SteeringMax
    steering_rate_max_rad_s: Positive
    counts_per_revolution: Counts
    steering_offset_rad: Real = 0.0

    def chassis(self, simulation: SimulationParameters) -> Chassis:
        """Return the wheels on the floor."""
        return _chassis(self, simulation, 0.0, front_driven=self.driven == "front")


@closed
@dataclass(frozen=True, slots=True)
class AckermannDrive:
    """A car: Ackermann steering at the front, one motor on a rear differential."""

    wheel_names: ClassVar = ("drive",)

    kind: Literal["ackermann"]
    wheelbase_m: Positive
    track_width_m: Positive
    wheel_radius_m: Positive
    steering_max_rad: SteeringMax
    steering_rate_max_rad_s: Positive
    counts_per_revolution: Counts
    steering_offset_rad: Real = 0.0

    def chassis(self, simulation: SimulationParameters) -> Chassis:
        """Return the wheels on the floor."""
        half_track = self.track_width_m * (1 + simulation.errors.track_width) / 2
        return _chassis(self, simulation, half_track, front_driven=False)


def _chassis(
    drive: TricycleDrive | AckermannDrive,
    simulation: SimulationParameters,
    half_track: float,
    *,
    front_driven: bool,
) -> Chassis:
    """Wheels of a bicycle: the front and the rear of a robot, each as one in its middle."""
    wheelbase = drive.wheelbase_m * (1 + simulation.errors.wheelbase)
    weight = simulation.mass_kg * GRAVITY_M_S2
    front = weight * simulation.centre_of_mass_m[0] / wheelbase
    rear = weight - front
    if front <= 0 or rear <= 0:
        raise tips_over(simulation, "the axles")
    (radius,) = true_radii(drive.wheel_names, (drive.wheel_radius_m,), simulation)
    if front_driven:
        rolling = Grip(wheelbase, 0.0, FORWARD, front, 0, 1.0, steered=True)
    else:
        rolling = Grip(0.0, 0.0, FORWARD, rear, 0, 1.0)
    # The driven tyres hold sideways by what rolling leaves them.
    if front_driven:
        front_wheel, spent_front, rear_wheel, spent_rear = 0, (0, 1), None, (0, 0)
    else:
        front_wheel, spent_front, rear_wheel, spent_rear = None, (0, 0), 0, (0, 1)
    free = rear if front_driven else front
    return Chassis(
        wheels=(Wheel(radius, front if front_driven else rear),),
        grips=(
            rolling,
            Grip(wheelbase, 0.0, LEFT, front, front_wheel, steered=True, spent_by=spent_front),
            Grip(0.0, 0.0, LEFT, rear, rear_wheel, spent_by=spent_rear),
        ),
        span_m=max(half_track, wheelbase),
        tyres_per_wheel=2 if isinstance(drive, AckermannDrive) else 1,
        drag=Drag(
            0.0 if front_driven else wheelbase,
            0.0,
            free * simulation.wheels.rolling_resistance,
        ),
        steering=Steering(
            drive.steering_max_rad,
            drive.steering_rate_max_rad_s,
            drive.steering_offset_rad + simulation.errors.steering_offset_rad,
        ),
    )
