"""Observations of the sensors since the last step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.zone import Point

if TYPE_CHECKING:
    from robotctl.model.sensors.range_scan import RangeScan  # which loads numpy


class Seen(NamedTuple):
    """Observations since the last step, each with the pose it was made from."""

    T_world_odom: SE2 = SE2()
    """The drift of `odom` now."""
    scans: Sequence[tuple[SE2, RangeScan]] = ()
    """Scans of a lidar, each with `base` in `odom` at its time."""
    ranges_m: tuple[float, ...] = ()
    """New sonar ranges, nan for those that are not new, in the order of the mounts [m]."""
    floor_base: Sequence[Point] = ()
    """Points on the floor in `base` [m], not to be driven over."""
    approaches: Sequence[tuple[float, float]] = ()
    """Range [m] and closing speed [m/s] of what moves before each sonar; empty: nothing does.

    Speed 0: it stands. What moves leaves no marks.
    """
