"""Sonar against odometry: an obstacle ahead must come closer as the robot drives.

Only sonars that look along the path can be judged, and only by what a passer-by cannot imitate: a
range that stays the same to the millimetre over the whole distance (the sensor is stuck), a near
obstacle that does not come closer (the wheels slip, or the robot is held), and front and rear both
changing as if the robot drove in the opposite direction (it does).
"""

from __future__ import annotations

import math
from typing import Final

from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.monitor import MonitorInputs

ALONG_RAD: Final = math.radians(20.0)
"""Angle within which a sonar looks along the path [rad]."""

TURN_RAD: Final = 0.1
"""A larger turn restarts a comparison [rad]."""

NEAR_M: Final = 0.6
"""Only closer obstacles can show wheel slip [m]: farther away, people walk along."""

SPREAD_M: Final = 0.05
"""Ranges within this are the same obstacle at the same place, noise included [m]."""

MATCH_M: Final = 0.08
"""How well the change of range must match the distance driven backwards [m]."""

MATCHING: Final = 0.8
"""Least share of the readings that must match: the last alone may be an outlier."""

READINGS: Final = 5
"""Readings a comparison needs; a fast robot drives farther than `travel_m` for them."""

_NEVER_NS: Final = -1
"""Earlier than any comparison [ns]."""


class _Track:
    """Readings of one sonar since its comparison began; `sign` 1 looks ahead, -1 behind.

    `matching` counts those that match the way backwards.
    """

    __slots__ = ("began_ns", "contradicted_ns", "farthest_m", "first_m", "matching", "name",
                 "nearest_m", "readings", "sign", "start")  # fmt: skip

    def __init__(self, name: str, sign: float) -> None:
        self.name = name
        self.sign = sign
        self.contradicted_ns = _NEVER_NS
        self.begin(math.nan, SE2(), 0)

    def begin(self, range_m: float, start: SE2, stamp_ns: int) -> None:
        """Start a comparison with this reading."""
        self.began_ns = stamp_ns
        self.first_m = self.nearest_m = self.farthest_m = range_m
        self.start = start
        self.readings = self.matching = 1

    def add(self, range_m: float, nearer_m: float) -> None:
        """Take another reading, after driving `nearer_m` towards what the sonar sees [m]."""
        self.matching += self.matches(range_m, nearer_m)
        self.nearest_m = min(self.nearest_m, range_m)
        self.farthest_m = max(self.farthest_m, range_m)
        self.readings += 1

    def matches(self, range_m: float, nearer_m: float) -> bool:
        """Whether a range has changed as if the robot had driven the other way."""
        return abs(range_m - self.first_m - nearer_m) <= MATCH_M


class SonarMonitor:
    """Compares the sonars along the path with odometry.

    Parameters
    ----------
    mounts
        The ring.
    travel_m
        Distance of a comparison [m], > 0.
    """

    def __init__(self, mounts: tuple[SonarMount, ...], travel_m: float) -> None:
        self._travel_m = travel_m
        self._tracks: dict[int, _Track] = {}
        for index, mount in enumerate(mounts):
            heading_rad = abs(wrap_angle(mount.heading_rad))
            if heading_rad <= ALONG_RAD:
                self._tracks[index] = _Track(mount.name, 1.0)
            elif heading_rad >= math.pi - ALONG_RAD:
                self._tracks[index] = _Track(mount.name, -1.0)

    def reset(self) -> None:
        """Restart all comparisons."""
        for track in self._tracks.values():
            track.readings = 0
            track.contradicted_ns = _NEVER_NS

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick; return a contradiction, None if none is."""
        fault = None
        for sonar in inputs.feedback.sonars:
            pose = inputs.motion.pose_odom_base
            found = self.take(sonar.first, sonar.ranges_m, pose, sonar.stamp_ns)
            fault = fault or found
        return fault

    def take(
        self, first: int, ranges_m: tuple[float, ...], pose_odom_base: SE2, stamp_ns: int
    ) -> Fault | None:
        """Take the ranges of sonars `first` on [m]; return a contradiction, None if none is."""
        fault = None
        for index, track in self._tracks.items():
            if first <= index < first + len(ranges_m):
                found = self._compare(track, ranges_m[index - first], pose_odom_base, stamp_ns)
                fault = fault or found
        return fault

    def _compare(self, track: _Track, range_m: float, pose: SE2, stamp_ns: int) -> Fault | None:
        """Add a reading to a comparison, and judge it after enough distance."""
        start = track.start
        turned = abs(wrap_angle(pose.theta_rad - start.theta_rad)) > TURN_RAD
        same = track.nearest_m == track.farthest_m == range_m
        echoes = math.isfinite(range_m + track.first_m)
        if track.readings == 0 or not echoes or (turned and not same):
            track.begin(range_m, pose, stamp_ns)
            return None
        ahead_m = (pose.x_m - start.x_m) * math.cos(start.theta_rad) + (
            pose.y_m - start.y_m
        ) * math.sin(start.theta_rad)
        track.add(range_m, ahead_m * track.sign)
        if turned:
            return self._compare_in_bend(track, pose)
        if abs(ahead_m) < self._travel_m or track.readings < READINGS:
            return None
        fault = self._judge(track, range_m, ahead_m * track.sign, stamp_ns)
        track.begin(range_m, pose, stamp_ns)
        return fault

    def _compare_in_bend(self, track: _Track, pose: SE2) -> Fault | None:
        """Judge readings that are identical after a turn: no wall stays that exactly."""
        way_m = math.hypot(pose.x_m - track.start.x_m, pose.y_m - track.start.y_m)
        if way_m < self._travel_m or track.readings < READINGS:
            return None
        return _stuck(track)

    def _judge(self, track: _Track, range_m: float, nearer_m: float, stamp_ns: int) -> Fault | None:
        """Return the fault after driving `nearer_m` towards an obstacle that the sonar sees [m]."""
        spread_m = track.farthest_m - track.nearest_m
        if spread_m <= SPREAD_M and nearer_m > 0.0 and track.farthest_m < NEAR_M:
            text = (
                f"odometry moved {nearer_m:.2f} m closer, but sonar {track.name} still measures "
                f"{range_m:.2f} m: the wheels slip, something holds the robot, or the sonar is "
                "stuck"
            )
            return Fault(FaultCode.WHEELS_SLIP, text, track.name)
        if spread_m == 0.0:
            return _stuck(track)
        is_match = track.matches(range_m, nearer_m)
        if is_match and track.matching >= MATCHING * track.readings:
            track.contradicted_ns = stamp_ns
            return self._contradiction(track.began_ns)
        return None

    def _contradiction(self, since_ns: int) -> Fault | None:
        """Return a fault if a sonar ahead and one behind see reversed motion at the same time.

        If they see it one after the other, it may be two people walking along with the robot.
        """
        against = [track for track in self._tracks.values() if track.contradicted_ns >= since_ns]
        if {track.sign for track in against} != {1.0, -1.0}:
            return None
        names = " and ".join(track.name for track in against)
        text = f"the robot moves in the opposite direction to odometry, by sonar {names}"
        return Fault(FaultCode.ODOMETRY_REVERSED, text)


def _stuck(track: _Track) -> Fault:
    text = f"sonar {track.name} is stuck at {track.nearest_m:.3f} m"
    return Fault(FaultCode.SONAR_STUCK, text, track.name)
