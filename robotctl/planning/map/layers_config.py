"""Settings of the live map."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class LayersConfig:
    """How long the map remembers, and what it may assume.

    Parameters
    ----------
    decay_s
        What no sensor has seen again for this long is forgotten [s], 0.1 to 86400.
    through_unknown
        Whether the robot may pass where neither map nor sensors know anything.
    sonar_beam_deg
        Opening of a sonar's cone, from edge to edge [deg], 1 to 90.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    decay_s: float = 30.0
    through_unknown: bool = False
    sonar_beam_deg: float = 25.0

    def __post_init__(self) -> None:
        for key, low, high in (("decay_s", 0.1, 86400.0), ("sonar_beam_deg", 1.0, 90.0)):
            value = getattr(self, key)
            if not low <= value <= high:
                raise InvalidValue(key, f"{value} found, {low:g} to {high:g} allowed", value)
