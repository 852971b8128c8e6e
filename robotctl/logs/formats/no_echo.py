"""Detection of a lidar's readings without an echo, by the readings themselves.

Lasers and logging programs write some length for a beam without an echo: 81.91 m (SICK LMS, 13 bits
of a centimetre), 8.191 m (of a millimetre), 51.15 m, 32.767 m, 50.00 m, the configured range.
Treated as echoes they would become walls, and free rays in unseen space.

Such a length shows in the log: readings pile up there at every place of the robot, and hardly any
echo is longer. A wall also gives many readings of one length, but from few places only, so scans of
one place count once; and echoes of other walls are longer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

KNOWN_CODES_M: Final = ((81.83, 81.91), (51.05, 51.16), (32.759, 32.767), (8.183, 8.191))
"""Minimum and maximum lengths that known lasers report without an echo [m]. If the longest reading
of a log is one of them, a single reading suffices."""

_UNKNOWN_REACH_M: Final = 81.83
_FARTHEST_M: Final = 1e6
_DENIED, _FEW = 0.01, 5
"""Share, and number, of echoes beyond a stated maximum range above which that is wrong."""
_TOLERANCE_M: Final = 1e-6
_BIN_M: Final = 0.001
_WIDTH: Final = 120
"""Maximum spread of lengths of one code [bins], known codes included."""
_LINK: Final = 60
"""Maximum gap between them [bins]."""
_BEFORE: Final = 2000
"""Range of shorter echoes for the usual count [bins]."""
_FACTOR: Final = 10.0
"""Height of a pile relative to the usual count."""
_LEAST, _LEAST_SHARE = 5, 0.0005
_STRAY, _STRAY_SHARE = 1, 0.0002
"""Maximum readings beside a pile that are echoes, as number and as share."""
_SOME: Final = 3.0
"""Multiple of the usual count up to which one length is still echoes."""
_OF_A_SCAN, _OF_A_SCAN_WIDE = 0.1, 0.3
"""Maximum shares of a scan's readings, of one length and within a pile's width, from one wall seen
from one place."""
_ECHOES_BEYOND: Final = 0.005
"""Share of the readings that may be echoes beyond the smallest code."""
_BEAMS, _OF_FEW = 4, 0.9
"""Number of directions in which the walls of a corridor along the drive may give one length, and
the share of the readings that they then have."""
_PLACE_M: Final = 0.1
"""Distance within which scans are of one place [m]."""


@dataclass(frozen=True, slots=True)
class Code:
    """Lengths that stand for no echo.

    Parameters
    ----------
    low_m, high_m
        Minimum and maximum length found [m].
    count
        Number of their readings.
    reach_m
        Least possible length [m]; echoes are shorter.
    """

    low_m: float
    high_m: float
    count: int
    reach_m: float


def reaches(
    what: str,
    scans: Sequence[NDArray[np.float64]],
    places: NDArray[np.float64],
    stated_m: Sequence[float],
    max_range_m: float | None,
    notes: list[str],
) -> list[float]:
    """Return the maximum range of each scan of a laser [m].

    It is the shortest length that stands for no echo, or less if the log states so and hardly an
    echo is longer; 81.83 m if nothing is known.

    Parameters
    ----------
    what
        Name of the laser, for people.
    scans, places
        As for `no_echo_codes`.
    stated_m
        Maximum range of each scan according to the log [m]; inf if not stated.
    max_range_m
        Value of the user [m]; None: not given.
    notes
        Sentences for people, extended here.
    """
    if max_range_m is not None:
        return [max_range_m] * len(scans)
    codes = no_echo_codes(scans, places)
    total = sum(map(len, scans))
    for code in codes:
        low, high = f"{code.low_m:.6g}", f"{code.high_m:.6g}"
        notes.append(
            f"{what}: {code.count} of {total} readings ({code.count / total:.1%}) are "
            f"{low if low == high else f'{low} to {high}'} m: taken for no echo"
        )
    least_m = min((code.reach_m for code in codes), default=math.inf)
    echoes = beyond = 0
    for ranges, reach_m in zip(scans, stated_m, strict=True):
        echo = ranges[(ranges > 0.0) & (ranges < least_m - _TOLERANCE_M)]
        echoes += len(echo)
        beyond += int(np.count_nonzero(echo > reach_m + _TOLERANCE_M))
    if beyond > max(_FEW, _DENIED * echoes):
        notes.append(
            f"{what}: the log tells of a reach of {min(stated_m):g} m, but "
            f"{beyond / echoes:.0%} of the echoes lie beyond it: not believed"
        )
        stated_m = [math.inf] * len(scans)
    return [
        reach_m if math.isfinite(reach_m := min(least_m, each)) else _UNKNOWN_REACH_M
        for each in stated_m
    ]


def valid_ranges(ranges: NDArray[np.float64], reach_m: float) -> NDArray[np.float64]:
    """Return ranges with inf from the maximum range on and nan for invalid readings."""
    ranges = np.where(ranges >= reach_m - _TOLERANCE_M, math.inf, ranges)
    return np.where(ranges > 0.0, ranges, math.nan)


def no_echo_codes(
    scans: Sequence[NDArray[np.float64]], places: NDArray[np.float64]
) -> tuple[Code, ...]:
    """Return the lengths that stand for no echo, the longest first; empty if none is found.

    Parameters
    ----------
    scans
        Readings of one laser, scan by scan [m]; those not finite or not above 0 are ignored.
    places
        Position of the robot at each, (n, 2) [m], in any frame in which it moves.
    """
    chosen = _of_places(scans, places)
    every = _lengths(scans)
    if len(every) == 0:
        return ()
    piles = [
        pile
        for pile in _piles(_lengths(chosen), len(chosen))
        if _is_one(chosen, *pile) or _many_directions(chosen, *pile)
    ]
    for low, high in KNOWN_CODES_M:
        if low - _TOLERANCE_M <= every.max() <= high + _TOLERANCE_M:
            piles = [(low, high), *(pile for pile in piles if pile[1] < low - _TOLERANCE_M)]
    codes = []
    for low, high in piles:
        found = every[(every >= low - _TOLERANCE_M) & (every <= high + _TOLERANCE_M)]
        first, last = float(found.min()), float(found.max())
        known = [
            a for a, b in KNOWN_CODES_M if a - _TOLERANCE_M <= first <= last <= b + _TOLERANCE_M
        ]
        codes.append(Code(first, last, len(found), known[0] if known else first))
    return tuple(codes)


def _lengths(scans: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return all readings that are lengths; the maximum of a number type is not one."""
    readings = np.concatenate([np.empty(0), *scans])
    return np.asarray(readings[(readings > 0.0) & (readings < _FARTHEST_M)])


def _of_places(
    scans: Sequence[NDArray[np.float64]], places: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return one scan from each place that the robot visits."""
    chosen, last = [], (math.inf, math.inf)
    for scan, (x, y) in zip(scans, places.tolist(), strict=True):
        if not math.hypot(x - last[0], y - last[1]) < _PLACE_M:
            chosen.append(scan)
            last = x, y
    return chosen


def _is_one(scans: Sequence[NDArray[np.float64]], low: float, high: float) -> bool:
    """Return whether the readings between two lengths [m] are all equal, as from no wall."""
    readings = np.concatenate([scan[(scan >= low) & (scan <= high)] for scan in scans])
    return bool(np.unique(readings, return_counts=True)[1].max() >= _OF_FEW * len(readings))


def _many_directions(scans: Sequence[NDArray[np.float64]], low: float, high: float) -> bool:
    """Return whether the readings between two lengths [m] have more than a few directions."""
    counts = np.zeros(max(map(len, scans)), np.int64)
    for scan in scans:
        counts[: len(scan)] += (scan >= low) & (scan <= high)
    few = np.sort(counts)[-_BEAMS:].sum()
    return bool(len(counts) <= 2 * _BEAMS or few < _OF_FEW * counts.sum())


def _piles(readings: NDArray[np.float64], places: int) -> list[tuple[float, float]]:
    """Return first and last length of each pile at the far end [m], the longest first."""
    bins, counts = np.unique(np.rint(readings / _BIN_M).astype(np.int64), return_counts=True)
    below = np.concatenate([[0], np.cumsum(counts)])
    total, at = len(readings), len(bins) - 1
    per_scan = total / max(places, 1)
    least = max(_LEAST, _LEAST_SHARE * total)
    beyond, found = 0, list[tuple[int, int]]()
    while at >= 0 and beyond <= _ECHOES_BEYOND * total:
        first = int(np.searchsorted(bins, bins[at] - _WIDTH + 1))
        usual = int(np.searchsorted(bins, bins[at] - _BEFORE))
        wide = int(below[at + 1] - below[first])
        wide_usual = _WIDTH / (_BEFORE - _WIDTH) * (below[first] - below[usual])
        one_usual = (below[at] - below[usual]) / max(at - usual, 1)
        if wide > max(least, _OF_A_SCAN_WIDE * per_scan, _FACTOR * wide_usual):
            mode = first + int(np.argmax(counts[first : at + 1]))
            low, high = _pile_around(bins, counts, mode, _SOME * wide_usual / _WIDTH)
        elif counts[at] > max(least, _OF_A_SCAN * per_scan, _FACTOR * one_usual):
            low, high = _pile_around(bins, counts, at, _SOME * one_usual)
        else:
            low = high = at + 1
        if low <= at and below[low] >= _LEAST:
            found.append((int(bins[low]), int(bins[high])))
            if len(found) > 1 and found[-2][1] - found[-1][0] < _WIDTH:
                found[-2:] = [(found[-1][0], found[-2][1])]
            beyond += int(below[at + 1] - below[high + 1])
        else:
            low = at
            beyond += int(counts[at])
        at = low - 1
    return [((low - 0.5) * _BIN_M, (high + 0.5) * _BIN_M) for low, high in found]


def _pile_around(
    bins: NDArray[np.int64], counts: NDArray[np.int64], mode: int, usual: float
) -> tuple[int, int]:
    """Return the first and last bin of the pile with the highest bin `mode`."""
    enough = max(_STRAY + 1, _STRAY_SHARE * counts[mode], usual)
    low = high = mode
    while low > 0 and counts[low - 1] >= enough and _is_near(bins, low - 1, low, mode):
        low -= 1
    while (
        high + 1 < len(bins) and counts[high + 1] >= enough and _is_near(bins, high + 1, high, mode)
    ):
        high += 1
    return low, high


def _is_near(bins: NDArray[np.int64], one: int, last: int, mode: int) -> bool:
    """Return whether a bin follows the last of a pile closely enough, and is near its mode."""
    return bool(abs(bins[one] - bins[last]) <= _LINK and abs(bins[one] - bins[mode]) < _WIDTH)
