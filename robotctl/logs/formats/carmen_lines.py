"""Lines of CARMEN logs, sorted by kind and parsed; `carmen_log` interprets them.

Each line ends with the time of the message, a host, and the time of the logger. PARAM,
ODOM, FLASER, RLASER, ROBOTLASER1 and ROBOTLASER2 are read; lines of other kinds are skipped.
http://carmen.sourceforge.net/logger_playback.html
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.log_text import LogFormatError, LogText, integer, numbers
from robotctl.logs.formats.times import unwrapped, wraps

READ: Final = ("PARAM", "ODOM", "FLASER", "RLASER", "ROBOTLASER1", "ROBOTLASER2")
"""Kinds of lines that are read."""

KNOWN: Final = frozenset(
    {*READ, "SYNC", "LASER3", "LASER4", "TRUEPOS", "NEFF", "MARKER", "NMEAGGA", "NMEARMC", "GPS"}
    | {"IMU", "NMEA-GGA", "REMISSIONFLASER", "REMISSIONRLASER", "ROBOTLASER3", "ROBOTLASER4"}
    | {f"RAWLASER{i}" for i in range(1, 5)}
)
"""Kinds of lines in logs of CARMEN and of programs that correct them."""


class OdometryLine(NamedTuple):
    """ODOM: line number, time [its unit] and pose [m, m, rad]."""

    number: int
    time: float
    pose: tuple[float, float, float]


class LaserLine(NamedTuple):
    """A scan: line number, time [its unit], ranges [m], poses of laser and robot (3,) [m, m, rad].

    `fan` holds the direction of the first beam, the step [rad] and the maximum range [m], if the
    line has them.
    """

    number: int
    time: float
    ranges_m: NDArray[np.float64]
    laser: NDArray[np.float64]
    robot: NDArray[np.float64]
    fan: tuple[float, float, float] | None = None


@dataclass(slots=True)
class CarmenLines:
    """Content of a log, sorted by kind; `lasers` by the first word of the line.

    `kinds` are the first words of all lines.
    """

    text: LogText
    parameters: dict[str, tuple[int, str]] = field(default_factory=dict)
    odometry: list[OdometryLine] = field(default_factory=list)
    lasers: dict[str, list[LaserLine]] = field(default_factory=dict)
    kinds: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)

    def parameter(self, name: str) -> float | None:
        """Return the number of a PARAM line; None if there is none.

        Raises
        ------
        LogFormatError
            If it is not a finite number.
        """
        if name not in self.parameters:
            return None
        number, word = self.parameters[name]
        return float(_finite(self.text, number, f"PARAM {name}", [word])[0])


def sorted_lines(text: LogText) -> CarmenLines:
    """Return all lines of a log, sorted by kind.

    Raises
    ------
    LogFormatError
        If a line is damaged; a damaged last one without an end is left out instead.
    """
    lines = CarmenLines(text, notes=list(text.notes()))
    strangers: Counter[str] = Counter()
    for number, line in enumerate(text.lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            lines.kinds.add(words[0])
            if words[0] in READ:
                _take(lines, number, words)
            elif not words[0].replace("-", "").isalnum() or not words[0][0].isupper():
                raise text.error(number, f"found {words[0][:24]!r}, allowed are {_allowed()}")
            elif words[0] not in KNOWN:
                strangers[words[0]] += 1
        except LogFormatError:
            if not text.is_open_end(number):
                raise
            lines.notes.append(f"{text.path}:{number}: the last line is cut short, left out")
    _go_on(lines)
    for word, count in strangers.items():
        lines.notes.append(f"{text.path}: {count} lines of unknown kind {word} skipped")
    return lines


def _go_on(lines: CarmenLines) -> None:
    """Unwrap a 32-bit clock, over all lines together.

    ODOM lines at the time 0, inserted by programs that correct logs, have no time.
    """
    kinds: list[list[Any]] = [lines.odometry, *lines.lasers.values()]
    timed = sorted(
        (line.number, kind, at, line.time)
        for kind, entries in enumerate(kinds)
        for at, line in enumerate(entries)
        if kind or line.time != 0.0
    )
    times = np.array([time for *_, time in timed])
    going_on = unwrapped(times)
    if not np.any(going_on != times):
        return
    lines.notes.append(wraps("lines", "s"))
    for (_, kind, at, _), time in zip(timed, going_on.tolist(), strict=True):
        kinds[kind][at] = kinds[kind][at]._replace(time=time)


def _allowed() -> str:
    """Return the kinds of lines, for messages."""
    return ", ".join((*READ, *sorted(KNOWN - set(READ))))


def _take(lines: CarmenLines, number: int, words: list[str]) -> None:
    """Add one line of a kind that is read."""
    if words[0] == "PARAM":
        if len(words) < 3:
            raise lines.text.error(number, "PARAM: a name and a value are needed")
        lines.parameters.setdefault(words[1], (number, words[2]))
    elif words[0] == "ODOM":
        lines.odometry.append(_odometry(lines.text, number, words))
    else:
        read = _flaser if words[0] in {"FLASER", "RLASER"} else _robot_laser
        scan = read(lines.text, number, words)
        lines.lasers.setdefault(words[0], []).append(scan)


def _odometry(text: LogText, number: int, words: list[str]) -> OdometryLine:
    """Read `ODOM x y theta tv rv accel time host logger_time`."""
    if len(words) < 8:
        raise text.error(
            number, f"ODOM: found {len(words) - 1} values, x y theta tv rv accel time are needed"
        )
    x, y, theta, time = _finite(text, number, "ODOM", [*words[1:4], words[7]]).tolist()
    return OdometryLine(number, time, (x, y, theta))


def _flaser(text: LogText, number: int, words: list[str]) -> LaserLine:
    """Read `FLASER n ranges x y theta odom_x odom_y odom_theta time host logger_time`.

    Some programs omit host and second time.
    """
    count = _count(text, number, words, 1)
    if len(words) not in {count + 9, count + 11}:
        raise text.error(
            number,
            f"{words[0]}: found {len(words) - 2} values after the number of readings, needed are "
            f"{count} ranges, x y theta odom_x odom_y odom_theta time host time",
        )
    ranges = numbers(text, number, words[2 : count + 2])
    tail = _finite(text, number, words[0], words[count + 2 : count + 9])
    return LaserLine(number, float(tail[6]), ranges, tail[:3], tail[3:6])


def _robot_laser(text: LogText, number: int, words: list[str]) -> LaserLine:
    """Read `ROBOTLASER1 type start fov step max accuracy mode n ranges [m remissions] ...`.

    Then follow the poses of laser and robot, five more values, the time, a host and a time. Logs
    of the first versions have no remissions, nor their number.
    """
    count = _count(text, number, words, 8)
    at = 9 + count
    rest = len(words) - at
    if rest > 14 and words[at].isdigit() and rest == 15 + int(words[at]):
        at += 1 + int(words[at])
    elif rest != 14:
        raise text.error(
            number,
            f"{words[0]}: found {max(rest, 0)} values after {count} ranges, needed are the "
            "number of remissions and these, and 14 more: poses of laser and robot, tv rv "
            "forward_safety side_safety turn_axis, time, host and time",
        )
    start, _, step, reach = _finite(text, number, words[0], words[2:6]).tolist()
    ranges = numbers(text, number, words[9 : 9 + count])
    tail = _finite(text, number, words[0], [*words[at : at + 6], words[at + 11]])
    return LaserLine(
        number, float(tail[6]), ranges, tail[:3], tail[3:6], (start, step, reach)
    )  # fmt: skip


def _count(text: LogText, number: int, words: list[str], at: int) -> int:
    """Return the number of readings, word `at` of a line."""
    if len(words) <= at:
        raise text.error(number, f"{words[0]}: the number of readings is missing")
    count = integer(text, number, f"{words[0]}: number of readings", words[at])
    if count < 1:
        raise text.error(number, f"{words[0]}: found {count} readings, at least 1 is needed")
    return count


def _finite(text: LogText, number: int, name: str, words: list[str]) -> NDArray[np.float64]:
    """Return words of a line as finite numbers."""
    values = numbers(text, number, words)
    if not all(map(math.isfinite, values.tolist())):
        raise text.error(number, f"{name}: found {' '.join(words)}, finite numbers are needed")
    return values
