"""Poses of a robot at the times of a recorded log's readings, by the log's odometry.

Readings count only while the odometry is known: not before its first or after its last pose, not in
its gaps, and only if both have the same clock. Omissions are noted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.timeline import Series, seconds
from robotctl.logs.formats.times import is_timeless, usual_pace
from robotctl.model.geometry.se2 import SE2
from robotctl.model.trajectory import Trajectory

FARTHEST_M: Final = 1e7
"""Maximum coordinate of a place on Earth [m]."""

_GAP_S, _PERIODS = 1.0, 10.0
"""Minimum length of a gap of the odometry [s], and in usual periods."""
_STOOD_M, _STOOD_RAD = 0.1, 0.1
"""Maximum motion over a gap during which the robot stood, so that its poses there are known."""

_JUMP_M: Final = 0.5
_SLOW_M_S, _FAST_M_S = 10.0, 50.0
_HASTE: Final = 5.0
"""A step is a jump if it is `_JUMP_M` longer than a drive at `_HASTE` times the usual speed,
clamped to `_SLOW_M_S` .. `_FAST_M_S`."""
_RESTART_M, _RESTART_RAD = 0.1, 0.1
"""Maximum step over which a restarted odometry continues its last pose."""
_NEAR_NS: Final = 500_000_000
"""Margin around a jump, within which a reading may be from either side [ns]."""
_PART: Final = 0.25
"""Minimum share of the poses in one part without a jump; with less they are of several robots."""

_OTHER_CLOCK_S: Final = 0.5
"""Minimum difference of two separate clocks [s]; no message is delayed that long."""


def trajectory(series: Series, notes: list[str]) -> tuple[Trajectory, NDArray[np.bool_]] | None:
    """Return the valid poses of a source, and the mask of their entries; None without any.

    Parameters
    ----------
    series
        Entries with values (x [m], y [m], theta [rad]).
    notes
        Sentences for people, extended here.
    """
    poses = np.array(series.values, np.float64).reshape(-1, 3)
    is_possible = np.all(np.abs(poses[:, :2]) <= FARTHEST_M, axis=1) & np.isfinite(poses[:, 2])
    wrong = np.flatnonzero(~is_possible)
    if len(wrong):
        x_m, y_m, theta_rad = poses[wrong[0]].tolist()
        notes.append(
            f"{len(wrong)} of {len(poses)} {series.what} left out: they are no poses; the first, "
            f"at {seconds(int(series.stamps_ns[wrong[0]]))} s, is {x_m:g} m, {y_m:g} m, "
            f"{theta_rad:g} rad"
        )
    if len(wrong) == len(poses):
        return None
    return Trajectory(series.stamps_ns[is_possible], poses[is_possible]), is_possible


def within(series: Series, known_ns: NDArray[np.int64], notes: list[str]) -> NDArray[np.bool_]:
    """Return whether each entry is within the time of the odometry, (n,); note how many are not.

    Parameters
    ----------
    series
        Entries of a source.
    known_ns
        Times of the odometry [ns], not empty.
    notes
        Sentences for people, extended here.
    """
    begin_ns, end_ns = int(known_ns[0]), int(known_ns[-1])
    is_inside = (series.stamps_ns >= begin_ns) & (series.stamps_ns <= end_ns)
    outside = series.stamps_ns[~is_inside]
    if len(outside):
        away_ns = max(begin_ns - int(outside[0]), int(outside[-1]) - end_ns)
        notes.append(
            f"{len(outside)} of {len(series)} {series.what} left out: they lie outside of the time "
            f"of the odometry, {seconds(begin_ns)} s to {seconds(end_ns)} s, by up to "
            f"{1e-9 * away_ns:.3f} s"
        )
    return is_inside


class Odometry:
    """Poses of `base` in the frame of the odometry.

    Parameters
    ----------
    path
        Path of the log, for messages.
    series
        Its values are rows (x [m], y [m], theta [rad]).
    notes
        Sentences for people, to be added to.
    begins
        Whether each row begins a new frame of the odometry, (n,), which continues or jumps there.

    Raises
    ------
    LogFormatError
        If there are no poses, or they are not of one robot.
    """

    def __init__(
        self,
        path: Path,
        series: Series,
        notes: list[str],
        begins: NDArray[np.bool_] | None = None,
    ) -> None:
        self._notes = notes
        known = trajectory(series, notes)
        if known is None:
            raise LogFormatError("; ".join([f"{path}: no {series.what} of use in it", *notes]))
        whole, is_possible = known
        begins = np.zeros(len(series), bool) if begins is None else begins
        jumps = _jumps(whole, series.is_held[is_possible], begins[is_possible])
        kept = _without_jumps(path, series.what, whole, jumps, notes)
        self.trajectory = Trajectory(whole.stamps_ns[kept], whole.poses[kept])
        self.rows = np.flatnonzero(is_possible)[kept]
        """Rows of the series that are the poses of the trajectory."""
        self._log_ns = series.log_ns[self.rows] if len(series.log_ns) else series.log_ns
        self._is_missing = _missing(self.trajectory)

    def has_clock_of(self, series: Series) -> bool:
        """Return whether a source has the clock of the odometry; note it if not."""
        ahead_s = self._ahead_s(series)
        if abs(ahead_s) <= _OTHER_CLOCK_S:
            return True
        self._notes.append(
            f"{len(series)} of {len(series)} {series.what} left out: their clock is "
            f"{abs(ahead_s):.3f} s {'ahead of' if ahead_s > 0.0 else 'behind'} that of "
            "the odometry, by the times at which the log received both; set the clocks of the "
            "robot's computers (NTP)"
        )
        return False

    def place(self, series: Series) -> list[tuple[int, Any, SE2]]:
        """Return time [ns], value and pose of each reading whose pose is known."""
        if not len(series) or not self.has_clock_of(series):
            return []
        stamps_ns, known_ns = series.stamps_ns, self.trajectory.stamps_ns
        is_inside = within(series, known_ns, self._notes)
        after = np.clip(np.searchsorted(known_ns, stamps_ns), 1, max(len(known_ns) - 1, 1))
        is_in_gap = is_inside & (stamps_ns < known_ns[after % len(known_ns)])
        is_in_gap &= np.append(self._is_missing, False)[after - 1]
        if np.any(is_in_gap):
            first = int(after[is_in_gap][0])
            self._notes.append(
                f"{np.count_nonzero(is_in_gap)} of {len(series)} {series.what} left out: "
                "the odometry says nothing meanwhile, for the first time from "
                f"{seconds(int(known_ns[first - 1]))} s to {seconds(int(known_ns[first]))} s"
            )
        return [
            (stamp_ns, value, pose)
            for stamp_ns, value, is_known in zip(
                stamps_ns.tolist(), series.values, (is_inside & ~is_in_gap).tolist(), strict=True
            )
            if is_known and (pose := self.trajectory.at(stamp_ns)) is not None
        ]

    def _ahead_s(self, series: Series) -> float:
        """Return the lead of a source's clock [s]; 0 if the log has no times of its own."""
        if not _goes_on(series.stamps_ns, series.log_ns) or not _goes_on(
            self.trajectory.stamps_ns, self._log_ns
        ):
            return 0.0
        order = np.argsort(self._log_ns, kind="stable")
        own_s = 1e-9 * (self.trajectory.stamps_ns - self._log_ns)[order].astype(np.float64)
        its_s = 1e-9 * (series.stamps_ns - series.log_ns).astype(np.float64)
        origin_ns = int(self._log_ns[order[0]])
        at_s = 1e-9 * (series.log_ns - origin_ns).astype(np.float64)
        known_s = 1e-9 * (self._log_ns[order] - origin_ns).astype(np.float64)
        return float(np.median(its_s - np.interp(at_s, known_s, own_s)))


def _goes_on(stamps_ns: NDArray[np.int64], log_ns: NDArray[np.int64]) -> bool:
    """Return whether the log's own times advance with it, not inserted by a converter."""
    return bool(len(log_ns)) and 2 * int(np.ptp(log_ns)) >= int(np.ptp(stamps_ns))


def _without_jumps(
    path: Path, what: str, whole: Trajectory, jumps: NDArray[np.bool_], notes: list[str]
) -> slice:
    """Return the longest part in which the robot never jumps; note what is left out."""
    stamps_ns, poses = whole.stamps_ns, whole.poses
    count = int(np.count_nonzero(jumps))
    if count == 0:
        return slice(0, len(poses))
    at = int(np.argmax(jumps))
    jump = (
        f"at {seconds(int(stamps_ns[at + 1]))} s by "
        f"{np.hypot(*(poses[at + 1] - poses[at])[:2]):.2f} m within "
        f"{1e-9 * int(stamps_ns[at + 1] - stamps_ns[at]):.3f} s"
    )
    edges = np.concatenate([[0], np.flatnonzero(jumps) + 1, [len(poses)]])
    longest = int(np.argmax(np.diff(edges)))
    begin, end = int(edges[longest]), int(edges[longest + 1])
    if begin > 0:
        begin += int(np.searchsorted(stamps_ns[begin:end], stamps_ns[begin - 1] + _NEAR_NS))
    if end < len(poses):
        end = begin + int(np.searchsorted(stamps_ns[begin:end], stamps_ns[end] - _NEAR_NS, "right"))
    if end - begin < _PART * len(poses):
        raise LogFormatError(
            f"{path}: {what}: the robot jumps {count} times in {len(poses)} poses, first {jump}: "
            "they are of several robots, or of several drives; a drive of one robot is needed"
        )
    notes.append(
        f"{what}: the robot jumps {count} time{'s' if count > 1 else ''}, first {jump}; the "
        f"longest part without is read, {len(poses) - end + begin} of {len(poses)} poses are left "
        "out"
    )
    return slice(begin, end)


def _jumps(
    whole: Trajectory, is_held: NDArray[np.bool_], begins: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return whether each step is longer than a robot can drive in its time, (n - 1,).

    The duration of a step to or from a pose with a held time is unknown.
    """
    restarts = begins[1:] & _moves(whole.poses, _RESTART_M, _RESTART_RAD)
    if is_timeless(whole.stamps_ns):
        return restarts
    steps_m = np.hypot(*np.diff(whole.poses[:, :2], axis=0).T)
    fast_m_s = min(_FAST_M_S, max(_SLOW_M_S, _HASTE * (usual_pace(whole) or 0.0)))
    too_far = steps_m > _JUMP_M + fast_m_s * 1e-9 * np.diff(whole.stamps_ns)
    return np.asarray(restarts | (too_far & ~is_held[1:] & ~is_held[:-1]))


def _moves(poses: NDArray[np.float64], distance_m: float, turn_rad: float) -> NDArray[np.bool_]:
    """Return whether each step moves or turns the robot by more, (n - 1,)."""
    dx, dy, turns = np.diff(poses, axis=0).T
    turns = np.remainder(turns + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray((np.hypot(dx, dy) > distance_m) | (np.abs(turns) > turn_rad))


def _missing(known: Trajectory) -> NDArray[np.bool_]:
    """Return the intervals without odometry, (n - 1,)."""
    spans_s = 1e-9 * np.diff(known.stamps_ns)
    if not len(spans_s):
        return np.zeros(0, bool)
    moved = _moves(known.poses, _STOOD_M, _STOOD_RAD)
    return moved & (spans_s > max(_GAP_S, _PERIODS * float(np.median(spans_s))))
