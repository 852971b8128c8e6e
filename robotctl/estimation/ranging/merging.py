"""One view of several lidars, each with its own mount and time."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_TOGETHER_NS: Final = 500_000_000
"""Age of another lidar's scan beyond which it has no part in a view; a leader silent for longer is
followed by another [ns]."""


class ScanMerger:
    """Joins the scans of a robot's lidars into one view at each scan of the first one heard.

    The last scans of the others are moved to its time by odometry. With one lidar, each scan is a
    view.

    Parameters
    ----------
    leader
        Name of the lidar at whose scans there is a view; None: the first one heard.
    """

    def __init__(self, leader: str | None = None) -> None:
        self._leader = leader
        self._last: dict[str, tuple[RangeScan, SE2]] = {}
        """Last scan of each lidar, and the odometry then."""

    def add(self, scan: RangeScan, odometry: SE2) -> RangeScan | None:
        """Take a scan and the pose of `base` in `odom` at its time; return a view, if it makes one.

        Scans come in the order of their times, those of one time in any order; the view then has
        what came before.
        """
        self._last[scan.name] = scan, odometry
        leader = self._leader
        led = self._last.get(leader or "")
        if leader is None or (led and scan.stamp_ns - led[0].stamp_ns > _TOGETHER_NS):
            self._leader = leader = scan.name
        if scan.name != leader:
            return None
        if len(self._last) == 1:
            return scan
        others = tuple(
            each.moved(odometry.inverse() @ then)
            for name, (each, then) in self._last.items()
            if name != leader and 0 <= scan.stamp_ns - each.stamp_ns <= _TOGETHER_NS
        )
        return replace(scan, others=others)
