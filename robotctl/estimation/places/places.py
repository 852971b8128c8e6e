"""Places known by sonar, and the comparison of a new signature with them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import InvalidValue
from robotctl.estimation.places.recogniser import Candidate, Recognition
from robotctl.estimation.places.signatures import Signature
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

ANY_HEADING: Final = math.pi**2 / 3.0
"""Variance of an unknown heading [rad^2]."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Differences of signatures: mean, standard deviation > 0, and how many were measured."""

    mean: float
    sigma: float
    measured: int = 0


@dataclass(frozen=True, slots=True)
class RecognitionConfig:
    """When a place is recognised.

    Parameters
    ----------
    within, between
        Expected differences of visits to one place, and of the most similar other place, before any
        were measured.
    prior_visits
        Number of measured differences that weigh as much as the assumed ones, > 0.
    ratio
        The best place's difference is at most this share of that of the next place, (0, 1].
    least_echoes
        Share of echoes that a place needs to be learnt, [0, 1].
    independent_bearings
        How many bearings are worth as much as all, since cones overlap, > 0: 360 deg / 25 deg.
    turn_sigma_rad
        Standard deviation of what odometry gets wrong in a turn on the spot [rad], >= 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    within: Spread = field(default_factory=lambda: Spread(0.05, 0.025))
    between: Spread = field(default_factory=lambda: Spread(0.45, 0.1))
    prior_visits: float = 4.0
    ratio: float = 0.7
    least_echoes: float = 0.25
    independent_bearings: float = 14.0
    turn_sigma_rad: float = 0.05

    def __post_init__(self) -> None:
        if not (self.prior_visits > 0.0 and self.independent_bearings > 0.0):
            raise ValueError("prior_visits and independent_bearings must be > 0")
        if not (0.0 < self.ratio <= 1.0 and 0.0 <= self.least_echoes <= 1.0):
            raise ValueError("ratio must be in (0, 1], least_echoes in [0, 1]")
        if not 0.0 <= self.turn_sigma_rad < math.inf:
            raise InvalidValue(
                "turn_sigma_rad",
                f"must be finite and >= 0, found {self.turn_sigma_rad}",
                self.turn_sigma_rad,
            )
        if not (
            self.within.mean < self.between.mean
            and min(self.within.sigma, self.between.sigma) > 0.0
        ):
            raise ValueError("within must be below between on average, both with a sigma > 0")


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """A signature, and the pose of `base` at its end: in `world`, or in the frame of the place."""

    pose: SE2
    signature: Signature


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A named place.

    Parameters
    ----------
    name
        Not empty, printable.
    in_world
        Whether the poses of its visits are in `world`. Else they are in a frame of its own, that of
        `base` at the first visit.
    visits
        At least one.

    Raises
    ------
    ValueError
        If the name is not allowed or there is no visit.
    """

    name: str
    in_world: bool
    visits: tuple[Visit, ...]

    def __post_init__(self) -> None:
        if not (self.name.strip() and self.name.isprintable()):
            raise InvalidValue(
                "name", f"must be printable and not empty, found {self.name!r}", self.name
            )
        if not self.visits:
            raise ValueError(f"place {self.name}: at least one visit is needed")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SonarCandidate(Candidate[str]):
    """A place where the robot may be, and its heading there.

    `pose` is in `world` or in the frame of the place; `score` is the share of the belief in this
    candidate among all, which sum to 1.

    Parameters
    ----------
    difference
        D, 0 to 1.
    in_world
        Whether the pose is in `world`.
    rotation_rad
        Heading now minus that at the place's first visit, in (-pi, pi].
    covariance
        Covariance (3, 3) of the pose [m, m, rad].
    """

    difference: float
    in_world: bool
    rotation_rad: float
    covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SonarRecognition(Recognition[SonarCandidate]):
    """Result of comparing a signature with the known places.

    Several candidates may be similar enough even if the place is refused.

    Parameters
    ----------
    threshold
        Maximum accepted difference.
    """

    threshold: float

    @property
    def rotation_variance(self) -> float:
        """Variance of the recognised place's rotation [rad^2], its other headings included."""
        best = self.candidates[0]
        same = [each for each in self.candidates if each.place == best.place]
        weight = sum(each.score for each in same)
        variance = sum(
            each.score
            * (each.covariance[2, 2] + wrap_angle(each.rotation_rad - best.rotation_rad) ** 2)
            for each in same
        )
        return min(float(variance / weight), ANY_HEADING)
