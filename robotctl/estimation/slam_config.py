"""Settings of SLAM while the robot drives; light enough for every process to read."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from robotctl.config_values import check_ranges
from robotctl.estimation.slam_tuning import SlamTuning


@dataclass(frozen=True, slots=True)
class SlamConfig:
    """Rate at which SLAM takes scans and redraws its map.

    Parameters
    ----------
    update_min_m, update_min_rad
        Motion after which a scan is taken [m], [rad], 0 to 1e4: a robot at rest sees the same.
    rest_s
        Time at rest after which a scan is taken [s], 0 to 1e4: the robot may have been moved by
        hand.
    redraw_shift_m
        Motion of a keyframe since it was drawn from which the map is drawn anew [m], 0 to 1e4.
    redraw_every_s
        Minimum interval between two drawings [s], 0 to 1e4.
    stages
        Thresholds of its stages.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    update_min_m: float = 0.05
    update_min_rad: float = 0.05
    rest_s: float = 1.0
    redraw_shift_m: float = 0.03
    redraw_every_s: float = 2.0
    stages: SlamTuning = field(default_factory=SlamTuning)

    def __post_init__(self) -> None:
        own = [each.name for each in fields(self) if each.name != "stages"]
        check_ranges(self, **dict.fromkeys(own, (0.0, 1e4)))
