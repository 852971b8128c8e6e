"""Obstacles that move by themselves, tracked from scan to scan.

Each piece of a scan that may be a person is tracked by a Kalman filter of constant velocity (white
acceleration: Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2), the same along both axes. It counts
as moving once it has come to where it was free, and its velocity is certain: see `segments`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.config import TracksConfig
from robotctl.planning.map.segments import (
    DIRECTIONS,
    NEW,
    RADIUS,
    SIGMA,
    PieceRules,
    X,
    Y,
    ranges_by_direction,
    segments_of,
)

_HISTORY_S: Final = 1.1
_APART_S: Final = 0.08
_MOST_SCANS: Final = 16
"""Longest history and least spacing of the scans that are kept [s], and room for so many."""
_TURN_S: Final = 0.8
"""Time over which a turning rate is averaged [s]."""
_SURE_M_S: Final = 0.13
"""Standard deviation of a velocity above which its changes say nothing of turns [m/s]."""
_LEAST_S: Final = 0.01
"""Least time between two scans that a rate is taken from [s]."""
_STRAIGHT_RAD_S: Final = 0.3
"""Turning rate up to which a track counts as straight [rad/s]."""
_MOST: Final = 100
"""Maximum number of tracks: room of the kernel's table, more than a scan has people."""

VX, VY, PP, PV, VV, SEEN_S, PROVEN_S, PROOFS, SIZE, TURN = range(2, 12)
"""Columns of tracks after `X` and `Y`: velocity, covariance of place, of place and velocity, of
velocity along either axis; times when it was seen and proven to move, in how many scans, radius,
turning rate."""
_COLUMNS: Final = 12
"""Number of all these columns."""


class TrackRules(NamedTuple):
    """The settings that the kernels need, each as in `TracksConfig`."""

    acceleration: float
    gate_m: float
    surprise_sigmas: float
    speed_sigma_m_s: float
    proven_s: float
    lost_s: float


class MovingObstacles:
    """Tracks of moving things around the robot.

    Places are in a frame that does not jump, that of the odometry. It is right for obstacles up to
    a metre wide that are not hidden most of the time.

    Parameters
    ----------
    config
        See there.
    """

    def __init__(self, config: TracksConfig = TracksConfig()) -> None:  # noqa: B008
        self._config = config
        self._rules = TrackRules(*(float(getattr(config, key)) for key in TrackRules._fields))
        self._pieces = PieceRules(
            config.margin_m, config.person_width_m, config.leg_width_m, config.stride_m
        )
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
        hits = (scan.ranges_m < scan.max_range_m) & (scan.ranges_m <= self._config.range_m)
        away = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
        ranges = np.where(hits, scan.ranges_m, 0.0)
        points = (sensor.x_m, sensor.y_m) + ranges[:, np.newaxis] * away
        spacing = abs(float(scan.angles_rad[1] - scan.angles_rad[0]))
        early = sum(now_ns - stamp_ns >= 1e9 * self._config.compare_s for stamp_ns in self._times)
        used = hits if counts is None else hits & counts
        first = _first_beam(scan.angles_rad, used, spacing)
        found = segments_of(
            np.roll(points, -first, axis=0),
            np.roll(used, -first),
            sensor.x_m,
            sensor.y_m,
            spacing,
            self._sensors[:early],
            self._scans[:early],
            self._pieces,
            self._config.free_scans,
        )
        since_s = 1e-9 * (now_ns - self._last_ns)
        self._tracks = advance(self._tracks, found, 1e-9 * now_ns, since_s, self._rules)
        self._last_ns = now_ns
        self._keep(sensor, bearings, scan, now_ns)

    def moving(self, T_world_odom: SE2) -> NDArray[np.float64]:
        """Return what moves, (k, 5): x, y, vx, vy in `world` and its radius [m, m/s].

        The velocity of who turns may be that expected in the mean of the next second or so.
        """
        tracks = self._tracks[is_moving(self._tracks, self._config)]
        places = moved(T_world_odom, tracks[:, [X, Y]])
        speeds = expected_velocities(tracks, self._config.turn_s) @ rotation(T_world_odom.theta_rad)
        radii = np.maximum(tracks[:, SIZE], self._config.radius_min_m)
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


def _first_beam(angles: NDArray[np.float64], counts: NDArray[np.bool_], spacing_rad: float) -> int:
    """Return the beam to begin with so that no piece of a scan all round is cut in two."""
    is_round = abs(float(angles[-1] - angles[0])) + 1.5 * spacing_rad >= math.tau
    return int(np.argmin(counts)) if is_round else 0


def is_moving(tracks: NDArray[np.float64], config: TracksConfig) -> NDArray[np.bool_]:
    """Return which tracks move, (k,)."""
    speed = np.hypot(tracks[:, VX], tracks[:, VY])
    moves: NDArray[np.bool_] = (
        (tracks[:, PROOFS] >= config.proofs)
        & (speed > config.speed_min_m_s)
        & (speed > config.certain_sigmas * np.sqrt(tracks[:, VV]))
        & (tracks[:, VV] < config.vague_m_s**2)
    )
    return moves


def expected_velocities(tracks: NDArray[np.float64], turn_s: float) -> NDArray[np.float64]:
    """Return the velocities of tracks (k, 12), turned on for a time [s], (k, 2) [m/s]."""
    rates = tracks[:, TURN]
    turns = turn_s * np.sign(rates) * np.maximum(np.abs(rates) - _STRAIGHT_RAD_S, 0.0)
    cos, sin = np.cos(turns), np.sin(turns)
    vx, vy = tracks[:, VX], tracks[:, VY]
    return np.column_stack([cos * vx - sin * vy, sin * vx + cos * vy])


@compiled
def advance(
    tracks: NDArray[np.float64],
    segments: NDArray[np.float64],
    now_s: float,
    since_s: float,
    rules: TrackRules,
) -> NDArray[np.float64]:
    """Return the tracks after the segments of a scan at a time, so long after the last [s]."""
    after = np.empty((_MOST, _COLUMNS))
    taken = np.zeros(len(segments), np.bool_)
    m = 0
    for i in range(len(tracks)):
        track = after[m]
        track[:] = tracks[i]
        _predict(track, since_s, rules)
        best = _nearest(track, segments, taken, rules)
        if best >= 0:
            taken[best] = True
            _correct(track, segments[best], since_s, rules)
            track[SEEN_S] = now_s
            if segments[best, NEW] >= 2.0 and now_s - track[PROVEN_S] >= _APART_S:
                track[PROOFS] += 1.0
                track[PROVEN_S] = now_s
        if now_s - track[PROVEN_S] > rules.proven_s:
            track[PROOFS] = 0.0
        if now_s - track[SEEN_S] <= rules.lost_s:
            m += 1
    for k in range(len(segments)):
        if not taken[k] and m < _MOST:
            track = after[m]
            track[:] = 0.0
            track[X], track[Y], track[SIZE] = segments[k, X], segments[k, Y], segments[k, RADIUS]
            track[PP], track[VV] = segments[k, SIGMA] ** 2, rules.speed_sigma_m_s**2
            track[SEEN_S] = now_s
            m += 1
    return after[:m]


@compiled
@borrows
def _predict(track: NDArray[np.float64], since_s: float, rules: TrackRules) -> None:
    """Move a track on by a time."""
    track[X] += track[VX] * since_s
    track[Y] += track[VY] * since_s
    q = rules.acceleration**2
    track[PP] += 2.0 * since_s * track[PV] + since_s**2 * track[VV] + q * since_s**3 / 3.0
    track[PV] += since_s * track[VV] + q * since_s**2 / 2.0
    track[VV] += q * since_s


@compiled
@borrows
def _nearest(
    track: NDArray[np.float64],
    segments: NDArray[np.float64],
    taken: NDArray[np.bool_],
    rules: TrackRules,
) -> int:
    """Return the free segment that is nearest to a track, within its gate; -1: none."""
    best, least = -1, np.inf
    for k in range(len(segments)):
        away = math.hypot(segments[k, X] - track[X], segments[k, Y] - track[Y])
        gate = rules.gate_m + 3.0 * math.sqrt(track[PP])
        if not taken[k] and away < min(least, gate):
            best, least = k, away
    return best


@compiled
@borrows
def _correct(
    track: NDArray[np.float64], segment: NDArray[np.float64], since_s: float, rules: TrackRules
) -> None:
    """Correct a track by the middle of a segment."""
    dx, dy = segment[X] - track[X], segment[Y] - track[Y]
    R = segment[SIGMA] ** 2
    if dx * dx + dy * dy > rules.surprise_sigmas**2 * (track[PP] + R):
        track[PROOFS] = track[TURN] = 0.0  # or it is two things, taken for one
        track[VV] += rules.speed_sigma_m_s**2
        track[PV] += since_s * rules.speed_sigma_m_s**2
        track[PP] += since_s**2 * rules.speed_sigma_m_s**2
    S = track[PP] + R
    gain_p, gain_v = track[PP] / S, track[PV] / S
    track[X] += gain_p * dx
    track[Y] += gain_p * dy
    vx, vy = track[VX] + gain_v * dx, track[VY] + gain_v * dy
    turn = math.atan2(track[VX] * vy - track[VY] * vx, track[VX] * vx + track[VY] * vy)
    share = 1.0 - math.exp(-since_s / _TURN_S)
    if track[PROOFS] > 0.0 and track[VV] < _SURE_M_S**2:
        track[TURN] += share * (turn / max(since_s, _LEAST_S) - track[TURN])
    else:
        track[TURN] = 0.0
    track[VX], track[VY] = vx, vy
    track[VV] -= gain_v * track[PV]
    track[PV] *= 1.0 - gain_p
    track[PP] *= 1.0 - gain_p
    track[SIZE] += 0.3 * (segment[RADIUS] - track[SIZE])
