"""Mounting of a sonar, its readings, and the travel time of sound."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

from robotctl.errors import InvalidValue

SPEED_OF_SOUND_M_S: Final = 343.0
"""Speed of sound in air at 20 degC [m/s]."""

FARTHEST_M: Final = 10.0
"""Maximum distance of a sonar from `base` along either axis [m]."""


def listening_ns(ranges_m: Iterable[float], max_range_m: float) -> int:
    """Return the listening time of sonars that fired together [ns].

    It lasts up to the last echo, or over the whole of `max_range_m` if one is missing (inf). The
    ranges were measured that long before they are sent.
    """
    farthest_m = max((r for r in ranges_m if not math.isnan(r)), default=0.0)
    return round(2e9 * min(farthest_m, max_range_m) / SPEED_OF_SOUND_M_S)


@dataclass(frozen=True, slots=True)
class SonarMount:
    """Mounting of one sonar in the `base` frame.

    Parameters
    ----------
    name
        Name of the sonar, not empty.
    x_m, y_m
        Position of its face in `base`, x forward, y left [m], at most 10 to each side.
    heading_deg
        Direction of its axis, 0 forward, 90 left [deg].

    Raises
    ------
    ValueError
        If the name is empty, a number is not finite, or the place cannot be on a robot.
    """

    name: str
    x_m: float
    y_m: float
    heading_deg: float

    def __post_init__(self) -> None:
        if not self.name:
            raise InvalidValue("name", f"must not be empty, found {self.name!r}", self.name)
        for key in ("x_m", "y_m", "heading_deg"):
            if not math.isfinite(getattr(self, key)):
                raise InvalidValue(
                    key, f"must be finite, found {getattr(self, key)}", getattr(self, key)
                )
        for key in ("x_m", "y_m"):
            if abs(value := getattr(self, key)) > FARTHEST_M:
                raise InvalidValue(
                    key, f"{value} found, -{FARTHEST_M:g} to {FARTHEST_M:g} allowed", value
                )

    @property
    def heading_rad(self) -> float:
        """Direction of the axis in `base` [rad]."""
        return math.radians(self.heading_deg)


class SonarReading(NamedTuple):
    """Readings of sonars that fired together.

    `stamp_ns` is the time of the sound. `ranges_m` has one range for each sonar of the robot:
    inf without echo, nan for those that did not fire then.
    """

    stamp_ns: int
    ranges_m: tuple[float, ...]

    @property
    def first(self) -> int:
        """Index of the first sonar that fired, which identifies the group."""
        return next(i for i, range_m in enumerate(self.ranges_m) if not math.isnan(range_m))
