"""Common parts of mission items: allowed values, and the default time-out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

from robotctl.errors import InvalidValue
from robotctl.planning.path.local.path import Point

LARGEST: Final = 1e6
"""No number of a mission is larger, whether metres, seconds, metres per second or degrees."""

NO_LENGTH_S: Final = 60.0
"""Default time-out of what has no length [s]."""

_SPARE_S: Final = 20.0
"""Time-out beyond three times what an item takes at full speed [s]."""


class Item(Protocol):
    """One step of a mission, as a file says it: a frozen dataclass, its `kind` a literal."""

    @property
    def kind(self) -> str:
        """Name in files."""

    @property
    def name(self) -> str:
        """Name shown to people."""


def time_for(length_m: float, speed_m_s: float) -> float:
    """Return the default time-out of a distance [s]: three times that at full speed, and some."""
    return 3.0 * length_m / speed_m_s + _SPARE_S


def require_bounded(item: object, *keys: str) -> None:
    """Refuse implausible numbers."""
    for key in keys:
        value = getattr(item, key)
        if not abs(value) <= LARGEST:
            raise InvalidValue(key, f"must be -{LARGEST:.0f} to {LARGEST:.0f}, not {value}", value)


def require_positive(item: object, *keys: str) -> None:
    """Refuse what is not above 0; None is allowed."""
    for key in keys:
        value = getattr(item, key)
        if value is not None and not 0.0 < value <= LARGEST:
            raise InvalidValue(
                key, f"must be above 0 and at most {LARGEST:.0f}, not {value}", value
            )


def require_points(key: str, points: Sequence[Point]) -> None:
    """Refuse points that are not on earth."""
    for point in points:
        if not all(abs(value) <= LARGEST for value in point):
            raise InvalidValue(
                key, f"must have coordinates of -{LARGEST:.0f} to {LARGEST:.0f}, not {point}", point
            )
