"""Inputs and outputs of a step of the navigator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from robotctl.messages.control import NavigationState
from robotctl.messages.requests import Request, on_earth
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.planning.guard.course import Point


class LoadRequest(NamedTuple):
    """Take another mission in place of the present one, or none."""

    mission: Mission | None


class NavigationInputs(NamedTuple):
    """All that a step depends on."""

    pose: SE2
    """`base` in `world`; in `odom` until its place in that is known, and not `localised` then."""
    twist: Twist
    """Present velocity of `base`."""
    ranges_m: tuple[float, ...]
    """One range for each sonar mount [m]: inf without echo, nan if missing, faulty or stale.

    Any other number of ranges counts as all missing.
    """
    received_ns: tuple[int, ...]
    """When each range came [ns]: one that came before the last step is not taken again."""
    enabled: bool
    """The control core follows commands now: armed and without fault."""
    requests: tuple[Request | LoadRequest, ...] = ()
    """Requests since the last step, oldest first."""
    localised: bool = True
    """The pose is more than a guess, though perhaps only odometry since a known place."""
    attended: bool = True
    """Whether the required operator is present."""
    station_lost: bool = False
    """A ground station that was there is lost since the last step."""
    control_is_fresh: bool = True
    """The control core has published recently; otherwise it is not `enabled` either."""
    late_ns: int = 0
    """How long the process was kept from this step, by its own measure [ns]."""
    blind: str = ""
    """Why the floor ahead is not seen; empty: it is, or the robot has no camera for it."""
    floor_base: Sequence[Point] = ()
    """Points on the floor not to be driven over."""
    epoch: tuple[int, int] = (0, 0)
    """Changes when the pose jumps, since the robot was found elsewhere: `WorldPose.epoch`."""
    scans: Sequence[tuple[SE2, RangeScan]] = ()
    """Scans of a lidar since the last step, each with `base` in `odom` at its time."""
    T_world_odom: SE2 = SE2()
    """The drift of `odom` now."""
    markers: Sequence[tuple[int, SE2]] = ()
    """Markers seen since the last step: number, and pose in `odom`, x into the marker."""
    charge: float = math.nan
    """Charge of the battery, in [0, 1]; nan: unknown."""

    @property
    def are_finite(self) -> bool:
        """Whether pose and velocity are numbers."""
        rest = self.pose.theta_rad + math.fsum(self.twist)
        return on_earth(self.pose.x_m, self.pose.y_m) and math.isfinite(rest)


class NavigationOutputs(NamedTuple):
    """Decisions of a step."""

    v_m_s: float
    omega_rad_s: float
    vy_m_s: float
    expires_ns: int | None
    """When a velocity of sticks or a set-point is void [ns]; None: it is neither."""
    state: NavigationState
    """State to publish; mission file, fence and rally points are left to the adapter."""
