"""Input of calibration: drives with a reference of the robot's pose."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.drives.motion import arc
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]

_ALIGNED_WAY_M = 2.0
_SPEED_S = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class OdometryRun:
    """One drive: turns of the wheels, and poses of the robot by a reference.

    Parameters
    ----------
    name
        For people.
    stamps_s
        (n + 1,) [s], not decreasing, n > 0.
    rolled
        (n, wheels + joints), between the times: turns of the wheels, angles of the joints [rad].
    reference_s, reference
        Times (m,) [s] and poses (m, 3) in `world`, m > 0; a heading that is nan is not known.
    start
        Pose of `base` at the first time; None: not known, to be estimated.
    start_sigma
        Standard deviations of `start`, (3,) [m, m, rad].

    Raises
    ------
    ValueError
        If the shapes do not fit or a time goes back.
    """

    name: str
    stamps_s: Array
    rolled: Array
    reference_s: Array
    reference: Array
    start: SE2 | None = None
    start_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        n, m = len(self.rolled), len(self.reference)
        if n == 0 or self.stamps_s.shape != (n + 1,) or self.rolled.ndim != 2:
            raise ValueError(f"{self.name}: found {self.stamps_s.shape} times, {n} steps of wheels")
        if m == 0 or self.reference_s.shape != (m,) or self.reference.shape != (m, 3):
            raise ValueError(f"{self.name}: found {self.reference_s.shape} times, {m} references")
        if np.any(np.diff(self.stamps_s) < 0.0) or np.any(np.diff(self.reference_s) < 0.0):
            raise ValueError(f"{self.name}: times must not decrease")
        if not (np.all(np.isfinite(self.rolled)) and np.all(np.isfinite(self.reference[:, :2]))):
            raise ValueError(f"{self.name}: wheels and positions must be finite")

    def speed_m_s(self, moves: Array) -> Array:
        """Return the speed ahead at each reference, over half a second, (m,) [m/s]."""
        distance_m = np.concatenate([[0.0], np.cumsum(moves[:, 0])])
        ahead = np.interp(self.reference_s + _SPEED_S, self.stamps_s, distance_m)
        behind = np.interp(self.reference_s - _SPEED_S, self.stamps_s, distance_m)
        return np.asarray((ahead - behind) / (2.0 * _SPEED_S))

    def part(self, begin_s: float, end_s: float) -> OdometryRun | None:
        """Return the part between two times [s], with an unknown start; None if it is too short."""
        steps = (self.stamps_s[:-1] >= begin_s) & (self.stamps_s[1:] <= end_s)
        first, last = np.flatnonzero(steps)[[0, -1]] if np.any(steps) else (0, -1)
        stamps_s = self.stamps_s[first : last + 2]
        if last < first:
            return None
        seen = (self.reference_s >= stamps_s[0]) & (self.reference_s <= stamps_s[-1])
        if np.count_nonzero(seen) < 3:
            return None
        return OdometryRun(
            self.name,
            stamps_s,
            self.rolled[first : last + 1],
            self.reference_s[seen],
            self.reference[seen],
        )


def thinned(run: OdometryRun, travel_m: Array, spacing_m: float) -> OdometryRun:
    """Return a run with one reference per distance travelled by its wheels.

    Over short distances many errors do not accumulate: the clock of a camera, the play of a
    gearbox, a lens. Accumulating errors, which are calibrated, show over longer ones.

    Parameters
    ----------
    travel_m
        How far the wheels travelled in each step, (n,) [m], >= 0.
    spacing_m
        > 0 [m].
    """
    distance_m = np.interp(
        run.reference_s, run.stamps_s, np.concatenate([[0.0], np.cumsum(travel_m)])
    )
    kept = np.unique(np.floor(distance_m / spacing_m), return_index=True)[1]
    return dataclasses.replace(
        run, reference_s=run.reference_s[kept], reference=run.reference[kept]
    )


def poses_at(run: OdometryRun, moves: Array, start: SE2, times_s: Array) -> Array:
    """Return dead reckoning by `moves` from `start` at given times, (k, 3), heading unwrapped.

    Between two stamps the robot has made its share of the move; outside of them it stands still.
    """
    alpha = moves[:, 1]
    theta = start.theta_rad + np.concatenate([[0.0], np.cumsum(alpha)])
    steps = _chords(moves, theta[:-1])
    at = np.array([start.x_m, start.y_m]) + np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    step = np.clip(np.searchsorted(run.stamps_s, times_s, side="right") - 1, 0, len(alpha) - 1)
    span = run.stamps_s[step + 1] - run.stamps_s[step]
    passed = np.clip(times_s - run.stamps_s[step], 0.0, span)
    share = np.divide(passed, span, out=np.ones_like(span), where=span > 0.0)
    here = at[step] + _chords(share[:, np.newaxis] * moves[step], theta[step])
    return np.column_stack([here, theta[step] + share * alpha[step]])


def _chords(moves: Array, theta: Array) -> Array:
    """Return the displacements of moves (n, 3) that begin with headings `theta`, (n, 2)."""
    d, alpha, sideways = moves.T
    shrink = np.sinc(0.5 * alpha / math.pi)
    chord, across = d * shrink, sideways * shrink
    c, s = np.cos(theta + 0.5 * alpha), np.sin(theta + 0.5 * alpha)
    return np.stack([chord * c - across * s, chord * s + across * c], axis=1)


def points_at(poses: Array, lever_m: Array) -> Array:
    """Return the positions of a point of `base` at poses (k, 3): (k, 2)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = lever_m
    return np.stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y], axis=1)


def guess_start(run: OdometryRun, moves: Array) -> SE2:
    """Return a run's approximate start: its first metres fitted to the reference."""
    if not math.isnan(run.reference[0, 2]):
        x, y, theta = run.reference[0].tolist()
        seen = SE2(x, y, theta)
        back = poses_at(run, moves, SE2(), run.reference_s[:1])[0].tolist()
        return seen @ SE2(*back).inverse()
    poses = poses_at(run, moves, SE2(), run.reference_s)
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    first = max(3, int(np.searchsorted(distance, _ALIGNED_WAY_M)))
    return align(poses[:first, :2], run.reference[:first, :2])


def dead_reckoning_error_m(run: OdometryRun, moves: Array, lever_m: Array, delay_s: float) -> Array:
    """Return how far dead reckoning is from each reference position, (m,) [m].

    From the known start, or else laid onto the reference as well as it goes without bending.
    """
    times_s = run.reference_s - delay_s
    if run.start is not None:
        points = points_at(poses_at(run, moves, run.start, times_s), lever_m)
    else:
        points = points_at(poses_at(run, moves, SE2(), times_s), lever_m)
        points = moved(align(points, run.reference[:, :2]), points)
    return np.asarray(np.hypot(*(points - run.reference[:, :2]).T))


def end_of(run: OdometryRun, moves: Array) -> SE2:
    """Return the end of dead reckoning from the start of the run."""
    pose = run.start or SE2()
    for d, alpha, sideways in moves.tolist():
        pose = arc(pose, d, alpha, sideways)
    return pose
