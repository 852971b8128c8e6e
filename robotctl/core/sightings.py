"""Sightings of lidar and camera, placed by odometry: floor, scans and markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

import numpy as np

from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.ranging.scan_messages import lidar_scan
from robotctl.estimation.ranging.unwinding import unwound
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import CameraView, LidarScan
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.guard.course import Point
from robotctl.planning.guard.floor_memory import FloorMemory, FloorView
from robotctl.safety.state_machine import POWERED

_VIEW_LIFE_NS: Final = 500_000_000
"""Maximum age of the camera's view for driving without an operator [ns]: at 1 m/s half of what the
view shows ahead; `_MISSED` periods of the camera bound it, too."""

_MISSED: Final = 2.5

_PICTURE_LIFE_NS: Final = 1_000_000_000
"""An older picture says nothing of what is ahead now, however late it came [ns]."""

_UNSEEN: Final = (
    "what was seen of the floor is forgotten: the robot does not drive forwards by itself until "
    "the camera has seen what lies right before it; back it up a little by hand"
)


class Sightings:
    """Places what is seen where `base` was in `odom` at its time.

    The floor is kept over stops, because odometry continues, and an object that the robot has
    stopped for is often below the picture.

    Parameters
    ----------
    reach_over_m
        Returns how far the body reaches over the floor now, ahead and behind, and to each side [m].
    camera_rate_hz
        Pictures a second of the camera that watches the floor; 0: there is none.

    Attributes
    ----------
    floor_base
        Points on the floor around not to be driven over, as of the last control state [m].
    """

    def __init__(
        self, reach_over_m: Callable[[], tuple[float, float]], camera_rate_hz: float
    ) -> None:
        self._reach_over_m = reach_over_m
        self._odometry = OdometryHistory()
        self._odom_epoch_ns: int | None = None
        """Epoch of the last state."""
        self._floor = FloorMemory()
        self.floor_base: list[Point] = []
        self._has_camera = camera_rate_hz > 0.0
        self._view_life_ns = 0
        if self._has_camera:
            self._view_life_ns = max(_VIEW_LIFE_NS, round(_MISSED * 1e9 / camera_rate_hz))
        self._view_ns: int | None = None
        """When the last view of the camera came [ns]."""

    def take(
        self, control: ControlState, seen: Sequence[LidarScan | CameraView], now_ns: int
    ) -> list[str]:
        """Take a control state, and what the camera saw since the last: the floor while armed.

        Return sentences for people.
        """
        odometry, notices = control.T_odom_base, []
        if control.odom_epoch_ns != self._odom_epoch_ns:
            self._odom_epoch_ns = control.odom_epoch_ns
            notices = self._forget(control, odometry)
        self._odometry.add(control.stamp_ns, odometry)
        views = [each for each in seen if isinstance(each, CameraView)]
        for view in views if control.state in POWERED else ():
            seen_from = self._odometry.at(view.stamp_ns)
            if seen_from is not None:
                self._floor.see(seen_from, _floor_view(view))
        self.floor_base = self._floor.around(odometry)
        if any(now_ns - each.stamp_ns <= _PICTURE_LIFE_NS for each in views):
            self._view_ns = now_ns
        return notices

    def blindness(self, now_ns: int) -> str:
        """Return why the floor ahead is not seen now, empty if it is, or need not be."""
        if not self._has_camera:
            return ""
        if self._view_ns is None:
            return "the camera has given no picture yet"
        age_ns = now_ns - self._view_ns
        if age_ns <= self._view_life_ns:
            return ""
        return f"the camera has given no picture for {age_ns / 1e9:.1f} s"

    def scans(self, seen: Sequence[LidarScan | CameraView]) -> list[tuple[SE2, RangeScan]]:
        """Return the scans of the lidar, each with `base` in `odom` at its time.

        Those of a time before the odometry, and those that are none, are left out.
        """
        placed = []
        for each in seen:
            if not isinstance(each, LidarScan):
                continue
            then = self._odometry.at(each.stamp_ns)
            with suppress(ValueError):
                scan = unwound(lidar_scan(each), self._odometry.at)
                placed += [] if then is None else [(then, scan)]
        return placed

    def markers(self, seen: Sequence[LidarScan | CameraView]) -> list[tuple[int, SE2]]:
        """Return the markers in the camera's views, each in `odom`."""
        views = [each for each in seen if isinstance(each, CameraView)]
        return [
            (marker.number, then @ SE2(marker.x_m, marker.y_m, marker.theta_rad))
            for view in views
            if (then := self._odometry.at(view.stamp_ns)) is not None
            for marker in view.markers
        ]

    def _forget(self, control: ControlState, odometry: SE2) -> list[str]:
        """Forget the floor; what lies below the picture of a moving robot is then unknown."""
        self._odometry, self._floor = OdometryHistory(), FloorMemory()
        if not (self._has_camera and control.armings):
            return []
        self._floor.doubt(odometry, *self._reach_over_m())
        return [_UNSEEN]


def _floor_view(view: CameraView) -> FloorView:
    """Return a view of the camera for the planning layer."""
    beams = (view.angles_rad, view.ranges_m, view.sigmas_m, view.nearest_m)
    angles, ranges, sigmas, nearest = (np.array(each, dtype=np.float64) for each in beams)
    return FloorView(view.x_m, view.y_m, angles, ranges, sigmas, nearest, not view.trouble)
