"""Edits of a map of keyframes that a person makes, in a TOML file that is kept and applied again.

Keyframes are numbered as in the map; those of a joined map follow, in the order of first mention.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from robotctl.config_values import ABOVE_0, check_ranges
from robotctl.errors import InvalidValue, RobotctlError
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.toml_source import Key, load

NO_MAP: Final = "no map of keyframes in it"


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """Two keyframes that see one place: `[[loop]]`.

    Parameters
    ----------
    keyframe, other
        Their numbers.
    x_m, y_m, heading_deg
        Pose of the other in the frame of the first: ahead and to the left [m], turned to the left
        [deg]; without a heading it may be any.
    within_m
        Distance from there, ahead and aside, within which the other is looked for by its scan [m],
        0.5 to 20; the heading is within 30 deg of the one given.
    exact
        Whether that pose holds as it is, to 0.02 m and 0.5 deg, and scans need only agree.
    unchecked
        Whether they need not even agree.

    Raises
    ------
    InvalidValue
        If a value is out of its range, or one of an exact pose is missing.
    """

    keyframe: int
    other: int
    x_m: float = 0.0
    y_m: float = 0.0
    heading_deg: float | None = None
    within_m: float = 2.0
    exact: bool = False
    unchecked: bool = False

    def __post_init__(self) -> None:
        _check_relation(self)
        _check_two(self.keyframe, self.other)

    @property
    def pose(self) -> SE2:
        """Pose of the other keyframe in the first."""
        return _pose(self.x_m, self.y_m, self.heading_deg or 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Join(Loop):
    """A map of another drive, put to this one by two keyframes: `[[join]]`.

    Parameters
    ----------
    map
        File of the other map; a relative path counts from the folder of the edits.
    keyframe, other
        A keyframe of this map, and one of the other, by its number there.
    x_m, y_m, heading_deg, within_m, exact, unchecked
        As in `Loop`.
    """

    map: str

    def __post_init__(self) -> None:
        _check_relation(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Refuse:
    """A loop that is wrong: `[[refuse]]`; it goes with all links between the two visits.

    Parameters
    ----------
    keyframe, other
        Two keyframes that it links, or whose neighbours it links.
    """

    keyframe: int
    other: int

    def __post_init__(self) -> None:
        _check_two(self.keyframe, self.other)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """A break of the way: `[[cut]]`; all links along the way from before to after it go.

    Parameters
    ----------
    before
        First keyframe after it.
    """

    before: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A keyframe whose pose is known: `[[move]]`.

    Parameters
    ----------
    keyframe
        Its number.
    x_m, y_m, heading_deg
        Its pose in `world` [m], [deg].
    sigma_m, sigma_deg
        Standard deviations [m], [deg], > 0.

    Raises
    ------
    InvalidValue
        If a value is out of its range.
    """

    keyframe: int
    x_m: float
    y_m: float
    heading_deg: float
    sigma_m: float = 0.05
    sigma_deg: float = 2.0

    def __post_init__(self) -> None:
        for key in ("x_m", "y_m"):
            check_ranges(self, **{key: (-math.inf, math.inf)})
        check_ranges(self, heading_deg=(-360.0, 360.0))
        check_ranges(self, sigma_m=(ABOVE_0, math.inf), sigma_deg=(ABOVE_0, math.inf))

    @property
    def pose(self) -> SE2:
        """Pose of the keyframe in `world`."""
        return _pose(self.x_m, self.y_m, self.heading_deg)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drop:
    """Keyframes that are left out: `[[drop]]`.

    Parameters
    ----------
    first, last
        Numbers of the first and last of them.

    Raises
    ------
    InvalidValue
        If the last is before the first.
    """

    first: int
    last: int

    def __post_init__(self) -> None:
        if self.last < self.first:
            raise InvalidValue(
                "last", f"{self.last} found, {self.first} or more allowed", self.last
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class MapEdits:
    """All edits of a map, in the order in which they are applied."""

    join: tuple[Join, ...] = ()
    drop: tuple[Drop, ...] = ()
    refuse: tuple[Refuse, ...] = ()
    cut: tuple[Cut, ...] = ()
    move: tuple[Move, ...] = ()
    loop: tuple[Loop, ...] = ()


def load_edits(file: Path, own: KeyframeMap) -> tuple[MapEdits, dict[str, KeyframeMap]]:
    """Return the edits in a file for a map, and the maps that they join, by name, in order.

    Raises
    ------
    ConfigError
        If the file is wrong, or names a map or a keyframe that there is not.
    """
    maps: dict[str, KeyframeMap] = {}

    def rules(edits: MapEdits) -> Iterator[tuple[Key, str]]:
        for number, each in enumerate(edits.join):
            problem = _join_problem(file.parent / each.map, each.map, own, maps)
            if problem:
                yield ("join", number, "map"), problem
        if all(each.map in maps for each in edits.join):
            yield from _unknown(edits, own, maps)

    return load(file, MapEdits, rules=rules), maps


def _join_problem(file: Path, name: str, own: KeyframeMap, maps: dict[str, KeyframeMap]) -> str:
    """Return what is wrong with a map to join, else load it, and return nothing."""
    if name in maps:
        return ""
    try:
        saved = load_keyframes(file)
    except RobotctlError as error:
        return str(error)
    if saved is None:
        return f"{file}: {NO_MAP if file.exists() else 'no such file'}"
    if saved.sensor != own.sensor:
        return f"{file}: a map made by {saved.sensor}, needed is one by {own.sensor}"
    maps[name] = saved
    return ""


class _Named(NamedTuple):
    """A keyframe that an edit names: where, its number, the numbers allowed, the first's number."""

    at: Key
    number: int
    allowed: range
    begin: int = 0


def _named(
    edits: MapEdits, own: KeyframeMap, maps: dict[str, KeyframeMap], numbers: range
) -> Iterator[_Named]:
    """Yield the keyframes that edits name, but those that are left out."""
    begins = offsets(own, maps)
    for row, join in enumerate(edits.join):
        others = range(len(maps[join.map].keyframes))
        yield _Named(("join", row, "keyframe"), join.keyframe, range(len(own.keyframes)))
        yield _Named(("join", row, "other"), join.other, others, begins[join.map])
    for row, cut in enumerate(edits.cut):
        yield _Named(("cut", row, "before"), cut.before, numbers[1:])
    for row, move in enumerate(edits.move):
        yield _Named(("move", row, "keyframe"), move.keyframe, numbers)
    for row, refuse in enumerate(edits.refuse):
        yield _Named(("refuse", row, "keyframe"), refuse.keyframe, numbers)
        yield _Named(("refuse", row, "other"), refuse.other, numbers)
    for row, loop in enumerate(edits.loop):
        yield _Named(("loop", row, "keyframe"), loop.keyframe, numbers)
        yield _Named(("loop", row, "other"), loop.other, numbers)


def _unknown(
    edits: MapEdits, own: KeyframeMap, maps: dict[str, KeyframeMap]
) -> Iterator[tuple[Key, str]]:
    """Yield keyframes that there are not, or not any more."""
    numbers = range(len(own.keyframes) + sum(len(each.keyframes) for each in maps.values()))
    dropped: dict[int, str] = {}
    for row, drop in enumerate(edits.drop):
        yield from _outside(("drop", row, "first"), drop.first, numbers)
        yield from _outside(("drop", row, "last"), drop.last, numbers)
        left_out = range(max(drop.first, 0), min(drop.last + 1, len(numbers)))
        dropped |= dict.fromkeys(left_out, f"drop[{row}]")
    if len(dropped) == len(numbers):
        yield ("drop",), f"all {len(numbers)} keyframes found, one must stay"
    for at, number, allowed, begin in _named(edits, own, maps, numbers):
        yield from _outside(at, number, allowed)
        if begin + number in dropped:
            yield at, f"{number} found, which {dropped[begin + number]} leaves out"


def _outside(at: Key, number: int, allowed: range) -> Iterator[tuple[Key, str]]:
    """Yield the number of a keyframe that there is not."""
    if number not in allowed:
        least, most = allowed[0], allowed[-1]
        nearest = min(max(number, least), most)
        yield at, f"{number} found, {least} to {most} allowed, the nearest is {nearest}"


def offsets(own: KeyframeMap, maps: dict[str, KeyframeMap]) -> dict[str, int]:
    """Return the number of the first keyframe of each joined map."""
    begin, result = len(own.keyframes), {}
    for name, each in maps.items():
        result[name] = begin
        begin += len(each.keyframes)
    return result


def _check_relation(relation: Loop) -> None:
    """Raise `InvalidValue` unless the pose of a relation can be one."""
    check_ranges(relation, x_m=(-math.inf, math.inf), y_m=(-math.inf, math.inf))
    check_ranges(relation, within_m=(0.5, 20.0))
    if relation.heading_deg is not None:
        check_ranges(relation, heading_deg=(-360.0, 360.0))
    elif relation.exact:
        raise InvalidValue("exact", "true found, allowed only with a heading_deg", value=True)
    if relation.unchecked and not relation.exact:
        raise InvalidValue("unchecked", "true found, allowed only with exact = true", value=True)


def _check_two(keyframe: int, other: int) -> None:
    """Raise `InvalidValue` unless two keyframes are two."""
    if keyframe == other:
        raise InvalidValue("other", f"{other} found, another than keyframe needed", other)


def _pose(x_m: float, y_m: float, heading_deg: float) -> SE2:
    return SE2(x_m, y_m, wrap_angle(math.radians(heading_deg)))
