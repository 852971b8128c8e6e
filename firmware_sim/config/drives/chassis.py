"""Wheels on the floor as the physics sees them, the same for every kind of drive.

A *wheel* here is one that a motor turns. A *grip* is one direction along which the floor can push
the robot: a tyre has one along its rolling direction and one across it, a mecanum wheel one along
the axis of the roller that touches the floor. Lengths and directions are in base.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from firmware_sim.config.parameters import SimulationParameters

GRAVITY_M_S2: Final = 9.80665
MAX_WHEELS: Final = 6
MAX_GRIPS: Final = 2 * MAX_WHEELS


class Hold(IntEnum):
    """Laws that bound the force of a grip."""

    ALONE = 0
    """Friction times load, less the share that the grips of `spent_by` use."""
    FIRST = 1
    """One friction circle together with the grip that follows."""
    SECOND = 2
    """One friction circle together with the grip before."""
    ROLLER = 3
    """Drag of a roller's bearing against the roller's turning."""


class Grip(NamedTuple):
    """One direction along which the floor can push the robot.

    Attributes
    ----------
    x_m, y_m
        Contact point.
    along
        Unit vector, for a steered wheel at steering angle 0.
    load_n
        Weight on the contact [N].
    wheel
        Number of its wheel; None: an undriven one, or several.
    roll
        Speed of the rim along it, per speed of the rim: 1 for the rolling direction, 0 across.
    steered
        Whether it turns with the steering.
    hold
        Law of its maximum force.
    spent_by
        First and last (excluded) of the grips whose forces use up its friction, with `ALONE`.
    """

    x_m: float
    y_m: float
    along: tuple[float, float]
    load_n: float
    wheel: int | None = None
    roll: float = 0.0
    steered: bool = False
    hold: Hold = Hold.ALONE
    spent_by: tuple[int, int] = (0, 0)


class Wheel(NamedTuple):
    """One driven wheel: true radius [m], and the load on it [N]."""

    radius_m: float
    load_n: float


class Drag(NamedTuple):
    """Constant drag of passive wheels: where [m], and how much [N]."""

    x_m: float
    y_m: float
    force_n: float


NO_DRAG: Final = Drag(0.0, 0.0, 0.0)


class Steering(NamedTuple):
    """Steering servo: stop [rad], greatest rate [rad/s], and true angle at a demand of 0 [rad]."""

    max_rad: float
    rate_max_rad_s: float
    offset_rad: float


@dataclass(frozen=True, slots=True)
class Chassis:
    """The true robot's wheels on the floor: nominal geometry with its errors applied.

    Attributes
    ----------
    wheels
        Driven wheels, in the order of the drive's names.
    grips
        Directions along which the floor can push the robot.
    span_m
        Distance of the farthest contact from base, for the speed of slipping tyres.
    tyres_per_wheel
        Wheels turned by one motor: two on the axle of a car.
    """

    wheels: tuple[Wheel, ...]
    grips: tuple[Grip, ...]
    span_m: float
    tyres_per_wheel: int = 1
    drag: Drag = NO_DRAG
    steering: Steering | None = None


FORWARD: Final = (1.0, 0.0)
LEFT: Final = (0.0, 1.0)


def true_radii(
    names: Sequence[str], nominal_m: Sequence[float], simulation: SimulationParameters
) -> tuple[float, ...]:
    """Radii of the wheels [m] with their errors.

    Raises
    ------
    ValueError
        If there are errors, but not one for each wheel.
    """
    errors = simulation.errors.wheel_radius or (0.0,) * len(names)
    if len(errors) != len(names):
        raise ValueError(
            f"simulation.errors.wheel_radius: {len(errors)} entries; allowed is one for each "
            f"wheel ({', '.join(names)}), or none"
        )
    return tuple(radius * (1.0 + error) for radius, error in zip(nominal_m, errors, strict=True))


def balanced_loads(
    contacts: Sequence[tuple[float, float]], simulation: SimulationParameters
) -> tuple[float, ...]:
    """Share the weight among contacts, by balance of forces and moments [N].

    More than three contacts get the loads of least squares: those of equal springs under a stiff
    body.

    Raises
    ------
    ValueError
        If the robot would tip over.
    """
    weight = simulation.mass_kg * GRAVITY_M_S2
    com_x, com_y = simulation.centre_of_mass_m
    x, y = np.array(contacts).T
    balance = np.array([np.ones(len(contacts)), x, y])
    demand = weight * np.array([1.0, com_x, com_y])
    loads = np.linalg.lstsq(balance, demand, rcond=None)[0]
    if np.min(loads) < 0.0:
        raise tips_over(simulation, "the wheels")
    return tuple(float(load) for load in loads)


def tips_over(simulation: SimulationParameters, supports: str) -> ValueError:
    """Return the error for a centre of mass outside the supports."""
    x_m, y_m = simulation.centre_of_mass_m
    return ValueError(
        f"simulation.centre_of_mass_m: at {x_m:g}, {y_m:g} the robot would tip over, allowed is a "
        f"place between {supports}"
    )


def span(contacts: Sequence[tuple[float, float]]) -> float:
    """Distance of the farthest contact from base [m]."""
    return max(math.hypot(x, y) for x, y in contacts)


def side_names(axles: Sequence[str]) -> tuple[str, ...]:
    """Names of the wheels of axles, left before right."""
    return tuple(f"{axle}_{side}" for axle in axles for side in ("left", "right"))


def side_contacts(axles_m: Sequence[float], track_width_m: float) -> Iterator[tuple[float, float]]:
    """Yield the contacts of axles at these x, left before right."""
    for x_m in axles_m:
        yield x_m, track_width_m / 2
        yield x_m, -track_width_m / 2
