"""Logs of odometry and ranges to beacons, as the Plaza data have them.

NAME_DR.txt: time [s], distance [m] and turn [rad] since the line before. NAME_TD.txt: time [s],
sender, beacon, range [m]. NAME_TL.txt, if there: beacon, x, y [m], as surveyed. NAME_GT.txt, if
there: time [s], x, y [m], heading [rad], the truth. Djugash, Hamner, Roth, Navigating with ranging
radios: five data sets with ground truth, Journal of Field Robotics 26 (2009); GTSAM has two of them
as text, in `examples/Data`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.log_text import LogFormatError, numbers, read_text
from robotctl.model.trajectory import Trajectory

ODOMETRY: Final = "_DR.txt"
"""End of the name of the file that a log is known by."""
_RANGES: Final = "_TD.txt"


@dataclass(frozen=True, slots=True, eq=False)
class RangeLog:
    """Odometry, and ranges to beacons.

    Parameters
    ----------
    stamps_s
        Of the odometry, (n,) [s].
    steps
        Distance [m] and turn [rad] since the stamp before, (n, 2).
    range_stamps_s, beacons, ranges_m
        When which beacon was how far away, (m,).
    surveyed
        Places of beacons, as far as they are known [m].
    reference
        The true drive, if the log has it.
    """

    stamps_s: NDArray[np.float64]
    steps: NDArray[np.float64]
    range_stamps_s: NDArray[np.float64]
    beacons: NDArray[np.int64]
    ranges_m: NDArray[np.float64]
    surveyed: dict[int, tuple[float, float]]
    reference: Trajectory | None


def is_range_log(path: Path) -> bool:
    """Return whether a path is the odometry of a log of ranges, with its ranges beside it."""
    return path.name.endswith(ODOMETRY) and path.is_file() and _beside(path, _RANGES).is_file()


def read_range_log(path: Path) -> RangeLog:
    """Read a log by the path of its odometry.

    Raises
    ------
    LogFormatError
        If a line has other columns, times do not ascend, or there is none at all.
    """
    odometry = _table(path, 3, ("time", "distance", "turn"))
    ranges = _table(_beside(path, _RANGES), 4, ("time", "sender", "beacon", "range"))
    places, truth = _beside(path, "_TL.txt"), _beside(path, "_GT.txt")
    surveyed = _table(places, 3, ("beacon", "x", "y")) if places.is_file() else np.empty((0, 3))
    reference = None
    if truth.is_file():
        rows = _table(truth, 4, ("time", "x", "y", "heading"))
        reference = Trajectory(np.round(rows[:, 0] * 1e9).astype(np.int64), rows[:, 1:])
    return RangeLog(
        odometry[:, 0], odometry[:, 1:], ranges[:, 0], ranges[:, 2].astype(np.int64), ranges[:, 3],
        {int(name): (float(x), float(y)) for name, x, y in surveyed}, reference,
    )  # fmt: skip


def _beside(path: Path, end: str) -> Path:
    return path.with_name(path.name.removesuffix(ODOMETRY) + end)


def _table(path: Path, width: int, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the lines of a file as numbers, (n, width); those with a time ascend by it."""
    text = read_text(path)
    rows: list[NDArray[np.float64]] = []
    for line, words in enumerate(map(str.split, text.lines), 1):
        if not words or words[0].startswith(("#", "%")):
            continue
        if len(words) != width:
            if text.is_open_end(line):
                break
            raise text.error(line, f"found {len(words)} words, needed are {', '.join(names)}")
        row = numbers(text, line, words)
        if not np.all(np.isfinite(row)):
            raise text.error(line, "found a number that is not finite")
        if names[0] == "time" and rows and row[0] < rows[-1][0]:
            raise text.error(line, f"time {row[0]} follows {rows[-1][0]}: times must ascend")
        rows.append(row)
    if not rows:
        raise LogFormatError(f"{path}: has no lines of {', '.join(names)}")
    return np.array(rows)
