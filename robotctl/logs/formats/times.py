"""Times of recorded logs: their unit, their range, clocks that wrap, stand still or go back.

A log is text of other programs that does not name the unit of its times. Times that cannot be
seconds are refused, because all results would be silently wrong: those out of range, and those that
let the robot creep or fly (`check_pace`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.toml_source import nearest

TIME_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of times [s]."""

FIRST_S, LAST_S = -1e5, 9.2e9
"""Range of times [s]: today's are 1.8e9 s; 64 bits of nanoseconds end in the year 2261. Programs
that count from some message of a log give earlier ones small negative times."""

_FINE_BELOW_S: Final = 4e6
"""Time below which a float resolves a nanosecond [s]."""
_WRAP: Final = 2.0**32
_NEAR_WRAP: Final = 2.0**24
"""Tolerance of the step of 2^32 at which a 32-bit clock wraps."""

_STEP_M: Final = 0.1
_STEPS: Final = 10
_CREEP_M_S, _FLY_M_S = 0.005, 50.0
"""Minimum and maximum usual speed of a robot [m/s]."""
_LONGEST_S: Final = 1e6
"""Maximum duration of a drive [s]."""


ErrorAt: TypeAlias = Callable[[int, str], LogFormatError]
"""Function that returns the error naming the line of the i-th time."""


def check_unit(unit: str | None) -> None:
    """Refuse an unknown unit of time.

    Raises
    ------
    ConfigError
        If it is not one of `TIME_UNITS`.
    """
    if unit is not None and unit not in TIME_UNITS:
        raise ConfigError(
            f"--time-unit {unit}: must be one of {', '.join(TIME_UNITS)}"
            f"{nearest(unit, tuple(TIME_UNITS))}"
        )


def stamps(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return times [s] as [ns], with the resolution of a float: microseconds for wall time."""
    fine = np.abs(seconds) < _FINE_BELOW_S
    nanoseconds = np.rint(np.where(fine, seconds, 0.0) * 1e9).astype(np.int64)
    return np.where(fine, nanoseconds, np.rint(seconds * 1e6).astype(np.int64) * 1000)


def checked_stamps(
    times: NDArray[np.float64], unit: str, error_at: ErrorAt, *, can_tell: bool = True
) -> NDArray[np.int64]:
    """Return times of a log in `unit`, (n,) finite, as [ns].

    `can_tell` is whether the user can give their unit.

    Raises
    ------
    LogFormatError
        If a time is out of range; names the line.
    """
    seconds = times * TIME_UNITS[unit]
    wrong = np.flatnonzero((seconds < FIRST_S) | (seconds > LAST_S))
    if len(wrong):
        at = int(wrong[0])
        raise error_at(
            at,
            f"time {times[at]:.15g} {unit}: allowed are {FIRST_S / TIME_UNITS[unit]:g} to "
            f"{LAST_S / TIME_UNITS[unit]:g} {unit}"
            f"{_hint(float(seconds[at]) / TIME_UNITS[unit], can_tell=can_tell)}",
        )
    return stamps(seconds)


def _hint(time: float, *, can_tell: bool) -> str:
    """Return the unit of a time, assuming a present date."""
    for unit, unit_s in TIME_UNITS.items():
        if 1e8 < time * unit_s <= LAST_S:
            advice = f"? Then give --time-unit {unit}" if can_tell else ", which this file must not"
            return f"; are the times {unit}{advice}"
    return ""


def is_timeless(stamps_ns: NDArray[np.int64]) -> bool:
    """Return whether several times are all equal, so that they give no order."""
    return len(stamps_ns) > 1 and bool(stamps_ns[0] == stamps_ns[-1])


def unwrapped(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unwrapped times of a 32-bit clock; none becomes negative."""
    if len(times) == 0:
        return times
    steps = np.diff(times)
    turns = np.where(np.abs(np.abs(steps) - _WRAP) < _NEAR_WRAP, -np.sign(steps), 0.0)
    added = np.concatenate([[0.0], np.cumsum(turns)])
    return np.asarray(times + _WRAP * (added - min(added.min(), 0.0)))


def going_on(
    times: NDArray[np.float64], unit: str, what: str, notes: list[str], error_at: ErrorAt
) -> NDArray[np.int64]:
    """Return `checked_stamps`, unwrapped, of a clock that may wrap after 2^32.

    Parameters
    ----------
    times, unit, error_at
        As for `checked_stamps`.
    what
        Name of the entries, for the note that the clock wraps: `scans`.
    notes
        Sentences for people, extended here.
    """
    unwound = unwrapped(times)
    if np.any(unwound != times):
        notes.append(wraps(what, unit))
    return checked_stamps(unwound, unit, error_at)


def wraps(what: str, unit: str) -> str:
    """Return a remark on a clock that wraps."""
    return f"{what}: their clock wraps after 2^32 {unit} and was unwrapped"


def note_pairs(times: NDArray[np.float64], what: str, notes: list[str]) -> None:
    """Note how many times equal the previous one, unless all do."""
    same = int(np.count_nonzero(np.diff(times) == 0.0))
    if 0 < same < len(times) - 1:
        notes.append(f"{same} of {len(times)} {what} have the time of the previous one")


def check_pace(recording: Recording, can_tell: bool) -> None:
    """Refuse a recording whose times let the robot creep or fly: they have another unit.

    Parameters
    ----------
    recording
        Recording as read.
    can_tell
        Whether the user can give the unit.

    Raises
    ------
    LogFormatError
        If its usual speed is not a robot's.
    """
    trajectory = recording.odometry or recording.reference
    pace_m_s = None if trajectory is None else usual_pace(trajectory)
    if pace_m_s is None or _CREEP_M_S <= pace_m_s <= _FLY_M_S:
        return
    raise LogFormatError(
        f"{recording.name}: by its times the log lasts {_span_s(recording):.4g} s and the robot "
        f"drives {pace_m_s:.2g} m/s; allowed are {_CREEP_M_S:g} to {_FLY_M_S:g} m/s"
        + ("; tell the unit of its times by --time-unit, s where this is right" if can_tell else "")
    )


def check_span(recording: Recording) -> None:
    """Refuse a recording that lasts longer than any drive.

    Raises
    ------
    LogFormatError
        If it lasts longer.
    """
    span_s = _span_s(recording)
    if span_s > _LONGEST_S:
        raise LogFormatError(
            f"{recording.name}: by its times the log lasts {span_s:.4g} s; allowed are up to "
            f"{_LONGEST_S:g} s, which is eleven days"
        )


def _span_s(recording: Recording) -> float:
    """Return the duration of a recording's motion [s]."""
    known = (recording.odometry, recording.reference)
    times = [each.stamps_ns for each in known if each is not None]
    if len(recording.twists):
        times.append(recording.twist_stamps_ns)
    return max((1e-9 * float(each[-1] - each[0]) for each in times), default=0.0)


def usual_pace(trajectory: Trajectory) -> float | None:
    """Return the median speed over stretches of `_STEP_M` [m/s]; None if there are too few."""
    points, stamps_ns = trajectory.poses[:, :2], trajectory.stamps_ns
    spans_s, begin = [], 0
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    lengths_m = []
    while True:
        end = max(int(np.searchsorted(way_m, way_m[begin] + _STEP_M)), begin + 1)
        if end >= len(way_m):
            break
        spans_s.append(1e-9 * float(stamps_ns[end] - stamps_ns[begin]))
        lengths_m.append(float(way_m[end] - way_m[begin]))
        begin = end
    moved = np.array(spans_s) > 0.0
    if np.count_nonzero(moved) < _STEPS:
        return None
    return float(np.median(np.array(lengths_m)[moved] / np.array(spans_s)[moved]))
