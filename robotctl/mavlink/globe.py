"""Latitude and longitude of `world`, once its origin on the globe is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue

_EQUATOR_M: Final = 6_378_137.0
_ECCENTRICITY_2: Final = 6.694_379_990_14e-3
"""Ellipsoid of WGS 84: half its longer axis [m], and its first eccentricity squared."""
STEEPEST_DEG: Final = 89.0
"""Maximum latitude [deg]: nearer to a pole, east is not the same direction across a building."""
FARTHEST_UP_M: Final = 100_000.0
SCALE: Final = 1e7
"""MAVLink counts latitude and longitude in 1e-7 degrees."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of `world` on the globe; x points east and y north there.

    Parameters
    ----------
    latitude_deg, longitude_deg
        In WGS 84 [deg], -89 to 89 and -180 to 180.
    altitude_m
        Above mean sea level [m], -100 000 to 100 000.

    Raises
    ------
    ValueError
        If it is not on the globe, or too near to a pole.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        for key, most in (
            ("latitude_deg", STEEPEST_DEG),
            ("longitude_deg", 180.0),
            ("altitude_m", FARTHEST_UP_M),
        ):
            value = getattr(self, key)
            if not abs(value) <= most:
                raise InvalidValue(key, f"{value} found, -{most:g} to {most:g} allowed", value)

    def to_world(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return x and y of a place near by [m]: on the plane that touches the globe."""
        north_m, east_m = self._metres_per_rad()
        away_deg = (longitude_deg - self.longitude_deg + 180.0) % 360.0 - 180.0
        return (
            east_m * math.radians(away_deg),
            north_m * math.radians(latitude_deg - self.latitude_deg),
        )

    def from_world(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return latitude and longitude of a point of `world` [deg]."""
        north_m, east_m = self._metres_per_rad()
        longitude_deg = self.longitude_deg + math.degrees(x_m / east_m)
        return (
            self.latitude_deg + math.degrees(y_m / north_m),
            (longitude_deg + 180.0) % 360.0 - 180.0,
        )

    def _metres_per_rad(self) -> tuple[float, float]:
        """Return the lengths of a radian of latitude and of longitude [m].

        The radii of curvature of the ellipsoid in the meridian and in the prime vertical, the
        latter times the cosine of the latitude (Snyder, Map Projections, 1987, p. 24-25).
        """
        latitude = math.radians(self.latitude_deg)
        w_2 = 1.0 - _ECCENTRICITY_2 * math.sin(latitude) ** 2
        across_m = _EQUATOR_M / math.sqrt(w_2)
        along_m = _EQUATOR_M * (1.0 - _ECCENTRICITY_2) / w_2**1.5
        return along_m, across_m * math.cos(latitude)
