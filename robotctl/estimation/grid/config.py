"""Settings of the occupancy grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class OccupancyGridConfig:
    """How much one measurement says of a cell, in log odds (Elfes 1989).

    Parameters
    ----------
    resolution_m
        Side of a cell [m].
    limit
        Log odds stay within this and its negative, so that a changed room is learnt again.
    hit
        Evidence of a lidar's echo from a cell, probability 0.7.
    miss
        Evidence of a lidar's beam that passes a cell, probability 0.45; counted negative. Less than
        a hit: poses and ranges err, and what grazes a wall would wipe it out.
    range_limit_m
        An echo beyond this only clears the beam up to here [m].
    no_echo_m
        Distance that a lidar beam without an echo clears [m]: dark or shiny things return none.
    fan_deg
        Lidar beams no farther apart are filled between [deg].
    sonar_hit
        Evidence of a sonar's echo, for all cells of the arc that it may have come from.
    sonar_miss
        Evidence of a sonar's cone for the cells before the echo; counted negative.
    sonar_width_deg
        Full width of a sonar's cone [deg].
    sonar_band_m
        Distance from the range within which cells count as at it [m].
    sonar_range_m
        A sonar's echo from farther says only that the cone is free up to here [m]: its arc is too
        wide to say where.
    sonar_no_echo_m
        Distance that a sonar without an echo clears [m]: smooth walls at an angle return none.
    camera_sigma_m
        Greatest standard deviation of a camera's range that is drawn [m].
    update_min_m, update_min_rad
        Motion after which a sensor draws again [m], [rad], >= 0: a robot at rest sees the same
        again, which is no new evidence.
    occupied_above
        Probability from which a cell of the live map is shown as occupied, 0.5 to 1: walls are seen
        many times, and one or two echoes are not yet one.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    resolution_m: float = 0.05
    limit: float = 4.0
    hit: float = 0.85
    miss: float = 0.2
    range_limit_m: float = 30.0
    no_echo_m: float = 2.0
    fan_deg: float = 1.5
    sonar_hit: float = 0.5
    sonar_miss: float = 0.25
    sonar_width_deg: float = 20.0
    sonar_band_m: float = 0.05
    sonar_range_m: float = 2.5
    sonar_no_echo_m: float = 1.0
    camera_sigma_m: float = 0.1
    update_min_m: float = 0.05
    update_min_rad: float = 0.05
    occupied_above: float = 0.85

    def __post_init__(self) -> None:
        for key in ("limit", "hit", "miss", "sonar_hit", "sonar_miss"):
            self._check(key, 0.0, math.inf)
        for key in (
            "range_limit_m",
            "no_echo_m",
            "sonar_band_m",
            "sonar_range_m",
            "sonar_no_echo_m",
            "camera_sigma_m",
        ):
            self._check(key, 0.0, 1e4)
        self._check("resolution_m", 1e-4, 1e4)
        self._check("fan_deg", 0.0, 90.0)
        self._check("sonar_width_deg", 0.0, 180.0)
        self._check("occupied_above", 0.5, 1.0)
        for key in ("update_min_m", "update_min_rad"):
            value = getattr(self, key)
            if not 0.0 <= value < 1e4:
                raise InvalidValue(key, f"must lie in [0, 10000), found {value}", value)
        for key in ("hit", "miss", "sonar_hit", "sonar_miss"):
            if not self.step <= getattr(self, key) <= self.limit:
                raise InvalidValue(
                    key,
                    f"must lie in [limit / {STEPS}, limit] = [{self.step:g}, {self.limit:g}], "
                    f"found {getattr(self, key)}",
                    getattr(self, key),
                )

    def _check(self, key: str, above: float, below: float) -> None:
        """Refuse a value that is not strictly between two bounds."""
        if not above < getattr(self, key) < below:
            raise InvalidValue(
                key,
                f"must lie in ({above:g}, {below:g}), found {getattr(self, key)}",
                getattr(self, key),
            )

    @property
    def step(self) -> float:
        """Log odds of one stored step."""
        return self.limit / STEPS

    def steps(self, evidence: float) -> int:
        """Return evidence in stored steps, rounded, at least 1."""
        return max(1, round(evidence / self.step))


STEPS = 127
"""Steps of stored log odds up to the limit, as int8."""
