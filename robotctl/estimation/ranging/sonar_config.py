"""Parameters of the sonars; without numpy, for every process that reads a robot's file."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class SonarModelConfig:
    """Echo limits and noise of a sonar.

    Parameters
    ----------
    beam_deg
        Opening of the cone, from edge to edge [deg], in (0, 180).
    max_incidence_deg
        Greatest angle between sound and a wall's normal that gives an echo [deg], in (0, 90).
    max_range_m
        Maximum range of an echo [m], > 0.
    sigma_m, sigma_per_m
        Standard deviation of a range: sigma_m + sigma_per_m * range, of sensor and map
        together [m], [1], > 0 and >= 0.
    random
        Probability of a range that has nothing to do with the map, > 0.
    none
        Probability that an echo is missing, > 0; random + none < 1.
    independent_readings
        Number of independent sonars that those of a ring are worth together, > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    beam_deg: float = 25.0
    max_incidence_deg: float = 35.0
    max_range_m: float = 4.0
    sigma_m: float = 0.05
    sigma_per_m: float = 0.01
    random: float = 0.15
    none: float = 0.1
    independent_readings: float = 4.0

    def __post_init__(self) -> None:
        bounds = {"beam_deg": 180.0, "max_incidence_deg": 90.0, "random": 1.0, "none": 1.0}
        for key in self.__slots__:
            value, greatest = getattr(self, key), bounds.get(key, math.inf)
            low_enough = value < greatest
            high_enough = value >= 0.0 if key == "sigma_per_m" else value > 0.0
            if not (low_enough and high_enough):
                raise InvalidValue(
                    key, f"{value} found, more than 0 and below {greatest} allowed", value
                )
        if self.random + self.none >= 1.0:
            raise ValueError(f"random + none must be < 1, found {self.random + self.none}")
