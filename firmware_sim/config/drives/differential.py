"""Two driven wheels on one axle, and a castor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from firmware_sim.config.drives.chassis import (
    FORWARD,
    GRAVITY_M_S2,
    LEFT,
    Chassis,
    Drag,
    Grip,
    Wheel,
    tips_over,
    true_radii,
)
from firmware_sim.config.quantities import Counts, Positive, closed

if TYPE_CHECKING:
    from firmware_sim.config.parameters import SimulationParameters


@closed
@dataclass(frozen=True, slots=True)
class DifferentialDrive:
    """Two driven wheels on one axle and a castor; base in the middle of the axle.

    `wheel_radius_m` is the mean of both wheels, `wheel_radius_ratio` right over left.
    """

    wheel_names: ClassVar = ("left", "right")

    kind: Literal["differential"]
    track_width_m: Positive
    wheel_radius_m: Positive
    counts_per_revolution: Counts
    wheel_radius_ratio: Annotated[float, Field(strict=True, ge=0.5, le=2.0)] = 1.0

    def chassis(self, simulation: SimulationParameters) -> Chassis:
        """Share the weight among the wheels and the castor, by balance of moments.

        Both tyres together resist sideways motion as one grip in the middle of the axle, which is
        equivalent.
        """
        weight = simulation.mass_kg * GRAVITY_M_S2
        half_track = self.track_width_m * (1 + simulation.errors.track_width) / 2
        com_x, com_y = simulation.centre_of_mass_m
        castor_x, castor_y = simulation.castor.position_m
        castor = weight * com_x / castor_x if castor_x != 0 else 0.0
        axle = weight - castor
        turning = (weight * com_y - castor * castor_y) / half_track
        left, right = (axle + turning) / 2, (axle - turning) / 2
        if min(castor, left, right) < 0:
            raise tips_over(simulation, "the wheels and the castor")
        left_m = 2.0 * self.wheel_radius_m / (1.0 + self.wheel_radius_ratio)
        radii = true_radii(self.wheel_names, (left_m, left_m * self.wheel_radius_ratio), simulation)
        return Chassis(
            wheels=(Wheel(radii[0], left), Wheel(radii[1], right)),
            grips=(
                Grip(0.0, half_track, FORWARD, left, 0, 1.0),
                Grip(0.0, -half_track, FORWARD, right, 1, 1.0),
                Grip(0.0, 0.0, LEFT, axle, spent_by=(0, 2)),
            ),
            span_m=half_track,
            drag=Drag(castor_x, castor_y, castor * simulation.castor.drag),
        )
