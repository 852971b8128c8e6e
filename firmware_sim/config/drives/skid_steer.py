"""Four or six driven wheels that do not steer: the robot turns by slipping sideways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from firmware_sim.config.drives.chassis import (
    FORWARD,
    LEFT,
    Chassis,
    Grip,
    Hold,
    Wheel,
    balanced_loads,
    side_contacts,
    side_names,
    span,
    true_radii,
)
from firmware_sim.config.quantities import Counts, Positive, closed

if TYPE_CHECKING:
    from firmware_sim.config.parameters import SimulationParameters


@closed
@dataclass(frozen=True, slots=True)
class SkidSteerDrive:
    """Two or three wheels on each side, all driven; base in the middle of the contacts.

    `wheelbase_m` is from the foremost to the rearmost axle. `slip_factor`, effective over geometric
    track width, is what robotctl believes; here it comes out of the tyres' friction.
    """

    kind: Literal["skid_steer"]
    track_width_m: Positive
    wheelbase_m: Positive
    wheel_radius_m: Positive
    counts_per_revolution: Counts
    wheels_per_side: Literal[2, 3] = 2
    slip_factor: Annotated[float, Field(strict=True, ge=1.0, le=10.0)] = 1.5

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the driven wheels."""
        middle = ("middle",) if self.wheels_per_side == 3 else ()
        return side_names(("front", *middle, "rear"))

    def chassis(self, simulation: SimulationParameters) -> Chassis:
        """Return the wheels on the floor: each tyre has a friction circle of its own."""
        half = self.wheelbase_m * (1 + simulation.errors.wheelbase) / 2
        axles = (half, 0.0, -half) if self.wheels_per_side == 3 else (half, -half)
        track = self.track_width_m * (1 + simulation.errors.track_width)
        contacts = tuple(side_contacts(axles, track))
        loads = balanced_loads(contacts, simulation)
        radii = true_radii(self.wheel_names, (self.wheel_radius_m,) * len(contacts), simulation)
        grips = []
        for wheel, ((x_m, y_m), load) in enumerate(zip(contacts, loads, strict=True)):
            grips.append(Grip(x_m, y_m, FORWARD, load, wheel, 1.0, hold=Hold.FIRST))
            grips.append(Grip(x_m, y_m, LEFT, load, wheel, hold=Hold.SECOND))
        return Chassis(
            wheels=tuple(Wheel(*each) for each in zip(radii, loads, strict=True)),
            grips=tuple(grips),
            span_m=span(contacts),
        )
