"""Wheels with rollers on their rims: robots that also move sideways."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, TypeAlias

from firmware_sim.config.drives.chassis import (
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
from firmware_sim.config.quantities import Counts, Positive, Real, closed

if TYPE_CHECKING:
    from firmware_sim.config.parameters import SimulationParameters

Vector: TypeAlias = tuple[float, float]

_HALF: Final = math.sqrt(0.5)
_MECANUM_AXES: Final = ((_HALF, -_HALF), (_HALF, _HALF), (_HALF, _HALF), (_HALF, -_HALF))
"""Axes of the rollers that touch the floor, in the order of the wheels.

They lie across the lines from the contacts to base, those on top along them: an X seen from above.
"""


@closed
@dataclass(frozen=True, slots=True)
class MecanumDrive:
    """Four wheels with rollers at 45 degrees; base in the middle of the contacts."""

    wheel_names: ClassVar = side_names(("front", "rear"))

    kind: Literal["mecanum"]
    track_width_m: Positive
    wheelbase_m: Positive
    wheel_radius_m: Positive
    counts_per_revolution: Counts

    def chassis(self, simulation: SimulationParameters) -> Chassis:
        """Return the wheels on the floor."""
        half = self.wheelbase_m * (1 + simulation.errors.wheelbase) / 2
        track = self.track_width_m * (1 + simulation.errors.track_width)
        contacts = tuple(side_contacts((half, -half), track))
        rolling = ((1.0, 0.0),) * 4
        radii = true_radii(self.wheel_names, (self.wheel_radius_m,) * 4, simulation)
        return on_rollers(contacts, rolling, _MECANUM_AXES, radii, simulation)


@closed
@dataclass(frozen=True, slots=True)
class OmniDrive:
    """Three or four wheels around base, with rollers that turn freely across the wheel.

    The first wheel stands at `first_wheel_deg`, the others follow evenly, all counter-clockwise
    from forward. Positive speeds turn the robot to the left.
    """

    kind: Literal["omni"]
    wheels: Literal[3, 4]
    wheel_distance_m: Positive
    wheel_radius_m: Positive
    counts_per_revolution: Counts
    first_wheel_deg: Real = 0.0

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the driven wheels."""
        return tuple(f"wheel_{number}" for number in range(1, self.wheels + 1))

    def chassis(self, simulation: SimulationParameters) -> Chassis:
        """Return the wheels on the floor."""
        distance = self.wheel_distance_m * (1 + simulation.errors.wheel_distance)
        first = math.radians(self.first_wheel_deg)
        angles = [first + math.tau * k / self.wheels for k in range(self.wheels)]
        contacts = [(distance * math.cos(a), distance * math.sin(a)) for a in angles]
        rolling = [(-math.sin(a), math.cos(a)) for a in angles]
        radii = true_radii(self.wheel_names, (self.wheel_radius_m,) * self.wheels, simulation)
        return on_rollers(contacts, rolling, rolling, radii, simulation)


def on_rollers(
    contacts: Sequence[Vector],
    rolling: Sequence[Vector],
    axes: Sequence[Vector],
    radii: Sequence[float],
    simulation: SimulationParameters,
) -> Chassis:
    """Wheels with rollers, from their contacts, rolling directions and axes of their rollers.

    A roller passes on force along its axis only. Across it, it turns against the drag of its
    bearing.
    """
    loads = balanced_loads(contacts, simulation)
    grips = []
    for k, ((x_m, y_m), (rx, ry), (ax, ay)) in enumerate(zip(contacts, rolling, axes, strict=True)):
        grips.append(Grip(x_m, y_m, (ax, ay), loads[k], k, rx * ax + ry * ay))
        if (drag_n := simulation.wheels.roller_drag * loads[k]) > 0.0:
            across = rx * -ay + ry * ax
            grips.append(Grip(x_m, y_m, (-ay, ax), drag_n, k, across, hold=Hold.ROLLER))
    return Chassis(
        wheels=tuple(Wheel(*each) for each in zip(radii, loads, strict=True)),
        grips=tuple(grips),
        span_m=span(contacts),
    )
