"""Obstacles that move by themselves, tracked from scan to scan.

Each piece of a scan that may be a person is tracked by a Kalman filter of constant velocity (white
acceleration: Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2), the same along both axes. It counts
as moving once it has come to where it was free, and its velocity is certain: see `segments`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.segments import (
    DIRECTIONS,
    NEW,
    RADIUS,
    SIGMA,
    X,
    Y,
    ranges_by_direction,
    segments_of,
)

_FARTHEST_M: Final = 8.0
"""Maximum range at which motion is judged [m]: farther out, beams lie too far apart."""
_HISTORY_S: Final = 1.1
"""How long earlier scans are kept [s]."""
_APART_S: Final = 0.08
"""At least between two that are kept [s]."""
_EARLIER_S: Final = 0.3
"""Age of the scan that a new one is compared with [s]: a slow person has moved by then."""
_MOST_SCANS: Final = 16
_MOST: Final = 100
"""Tracks."""

_ACCELERATION: Final = 0.2
"""Standard deviation of the acceleration, times the root of a second [m/s^1.5]."""
_SURPRISE: Final = 9.0
"""Squared standard deviations by which a place may differ from what was expected: 3 of them. Where
it differs more, the obstacle has changed its velocity, which is as good as unknown again."""
_FIRST_M_S: Final = 1.5
"""Standard deviation of the velocity of a new track [m/s]."""
_GATE_M: Final = 0.25
"""A segment this near to a track belongs to it, and three standard deviations beyond [m]."""
_LOST_S: Final = 0.5
"""A track that is not seen for this long ends [s]."""
_SLOWEST_M_S: Final = 0.15
"""Minimum speed of a moving thing [m/s]."""
_CERTAIN: Final = 2.0
"""A velocity is certain if it is so many standard deviations from 0."""
_VAGUE_M_S: Final = 0.35
"""A velocity with a greater standard deviation says nothing [m/s]."""
_PROOF: Final = 2
"""Scans in which a track has points that came lately, before it counts as moving."""
_PROVEN_S: Final = 1.0
"""How long such proof lasts [s]."""
_LEAST_RADIUS_M: Final = 0.2

VX, VY, PP, PV, VV, SEEN_S, PROVEN_S, PROOFS, SIZE = range(2, 11)
"""Columns of tracks after `X` and `Y`: velocity, covariance of place, of place and velocity, of
velocity along either axis; times when it was seen and proven to move, in how many scans, radius."""
_COLUMNS: Final = 11


class MovingObstacles:
    """Tracks of moving things around the robot.

    Places are in a frame that does not jump, that of the odometry. It is right for obstacles up to
    a metre wide that are not hidden most of the time.
    """

    def __init__(self) -> None:
        self.reset()
        warm = RangeScan(0, np.zeros(2), np.ones(2), 2.0)
        self.step(SE2(), warm, 0, np.ones(2, np.bool_))
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._tracks = np.empty((0, _COLUMNS))
        self._last_ns = 0
        self._times: list[int] = []
        self._sensors = np.zeros((_MOST_SCANS, 2))
        self._scans = np.zeros((_MOST_SCANS, DIRECTIONS), np.float32)

    def step(
        self,
        T_odom_base: SE2,
        scan: RangeScan,
        now_ns: int,
        counts: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take a scan.

        Parameters
        ----------
        T_odom_base
            The robot's pose when it was taken.
        scan
            Its beams in their order, at equal angles.
        now_ns
            Time of the scan [ns], later than the last.
        counts
            (n,): False for beams that the map explains; None: it explains nothing.
        """
        sensor = T_odom_base @ SE2(scan.x_m, scan.y_m, 0.0)
        bearings = scan.angles_rad + sensor.theta_rad
        hits = (scan.ranges_m < scan.max_range_m) & (scan.ranges_m <= _FARTHEST_M)
        away = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
        ranges = np.where(hits, scan.ranges_m, 0.0)
        points = (sensor.x_m, sensor.y_m) + ranges[:, np.newaxis] * away
        spacing = abs(float(scan.angles_rad[1] - scan.angles_rad[0]))
        early = sum(now_ns - stamp_ns >= 1e9 * _EARLIER_S for stamp_ns in self._times)
        found = segments_of(
            points,
            hits if counts is None else hits & counts,
            sensor.x_m,
            sensor.y_m,
            spacing,
            self._sensors[:early],
            self._scans[:early],
        )
        since_s = 1e-9 * (now_ns - self._last_ns)
        self._tracks = advance(self._tracks, found, 1e-9 * now_ns, since_s)
        self._last_ns = now_ns
        self._keep(sensor, bearings, scan, now_ns)

    def moving(self, T_world_odom: SE2) -> NDArray[np.float64]:
        """Return what moves, (k, 5): x, y, vx, vy in `world` and its radius [m, m/s]."""
        tracks = self._tracks[is_moving(self._tracks)]
        places = moved(T_world_odom, tracks[:, [X, Y]])
        speeds = tracks[:, [VX, VY]] @ rotation(T_world_odom.theta_rad)
        radii = np.maximum(tracks[:, SIZE], _LEAST_RADIUS_M)
        return np.column_stack([places, speeds, radii])

    def _keep(
        self, sensor: SE2, bearings: NDArray[np.float64], scan: RangeScan, now_ns: int
    ) -> None:
        """Keep a scan for later, and drop those that are too old."""
        old = sum(now_ns - stamp_ns > 1e9 * _HISTORY_S for stamp_ns in self._times)
        old = max(old, len(self._times) + 1 - _MOST_SCANS)
        if old:
            del self._times[:old]
            kept = len(self._times)
            self._sensors[:kept] = self._sensors[old : old + kept]
            self._scans[:kept] = self._scans[old : old + kept]
        if self._times and now_ns - self._times[-1] < 1e9 * _APART_S:
            return
        self._sensors[len(self._times)] = sensor.x_m, sensor.y_m
        self._scans[len(self._times)] = ranges_by_direction(
            bearings, scan.ranges_m, scan.max_range_m
        )
        self._times.append(now_ns)


def is_moving(tracks: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which tracks move, (k,)."""
    speed = np.hypot(tracks[:, VX], tracks[:, VY])
    moves: NDArray[np.bool_] = (
        (tracks[:, PROOFS] >= _PROOF)
        & (speed > _SLOWEST_M_S)
        & (speed > _CERTAIN * np.sqrt(tracks[:, VV]))
        & (tracks[:, VV] < _VAGUE_M_S**2)
    )
    return moves


@compiled
def advance(
    tracks: NDArray[np.float64], segments: NDArray[np.float64], now_s: float, since_s: float
) -> NDArray[np.float64]:
    """Return the tracks after the segments of a scan at a time, so long after the last [s]."""
    after = np.empty((_MOST, _COLUMNS))
    taken = np.zeros(len(segments), np.bool_)
    m = 0
    for i in range(len(tracks)):
        track = after[m]
        track[:] = tracks[i]
        _predict(track, since_s)
        best = _nearest(track, segments, taken)
        if best >= 0:
            taken[best] = True
            _correct(track, segments[best], since_s)
            track[SEEN_S] = now_s
            if segments[best, NEW] >= 2.0 and now_s - track[PROVEN_S] >= _APART_S:
                track[PROOFS] += 1.0
                track[PROVEN_S] = now_s
        if now_s - track[PROVEN_S] > _PROVEN_S:
            track[PROOFS] = 0.0
        if now_s - track[SEEN_S] <= _LOST_S:
            m += 1
    for k in range(len(segments)):
        if not taken[k] and m < _MOST:
            track = after[m]
            track[:] = 0.0
            track[X], track[Y], track[SIZE] = segments[k, X], segments[k, Y], segments[k, RADIUS]
            track[PP], track[VV] = segments[k, SIGMA] ** 2, _FIRST_M_S**2
            track[SEEN_S] = now_s
            m += 1
    return after[:m]


@compiled
def _predict(track: NDArray[np.float64], since_s: float) -> None:
    """Move a track on by a time."""
    track[X] += track[VX] * since_s
    track[Y] += track[VY] * since_s
    q = _ACCELERATION**2
    track[PP] += 2.0 * since_s * track[PV] + since_s**2 * track[VV] + q * since_s**3 / 3.0
    track[PV] += since_s * track[VV] + q * since_s**2 / 2.0
    track[VV] += q * since_s


@compiled
def _nearest(
    track: NDArray[np.float64], segments: NDArray[np.float64], taken: NDArray[np.bool_]
) -> int:
    """Return the free segment that is nearest to a track, within its gate; -1: none."""
    best, least = -1, np.inf
    for k in range(len(segments)):
        away = math.hypot(segments[k, X] - track[X], segments[k, Y] - track[Y])
        gate = _GATE_M + 3.0 * math.sqrt(track[PP])
        if not taken[k] and away < min(least, gate):
            best, least = k, away
    return best


@compiled
def _correct(track: NDArray[np.float64], segment: NDArray[np.float64], since_s: float) -> None:
    """Correct a track by the middle of a segment."""
    dx, dy = segment[X] - track[X], segment[Y] - track[Y]
    R = segment[SIGMA] ** 2
    if dx * dx + dy * dy > _SURPRISE * (track[PP] + R):
        track[PROOFS] = 0.0  # or it is two things, taken for one
        track[VV] += _FIRST_M_S**2
        track[PV] += since_s * _FIRST_M_S**2
        track[PP] += since_s**2 * _FIRST_M_S**2
    S = track[PP] + R
    gain_p, gain_v = track[PP] / S, track[PV] / S
    track[X] += gain_p * dx
    track[Y] += gain_p * dy
    track[VX] += gain_v * dx
    track[VY] += gain_v * dy
    track[VV] -= gain_v * track[PV]
    track[PV] *= 1.0 - gain_p
    track[PP] *= 1.0 - gain_p
    track[SIZE] += 0.3 * (segment[RADIUS] - track[SIZE])
