"""Campaign files: what varies between runs, and when a run passes. See docs/campaigns.md."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from robotctl.errors import InvalidValue

BOUNDARY: Final = "boundary"
"""Method of a sample: a search."""
BATCH: Final = 16
"""Points of a search that are decided together, whatever the workers, from those before."""
FROM, TO, LOG = "from", "to", "log"
AXES: Final = ("robot", "world", "mission", "faults", "options")
"""Factors beside settings and the seed."""


@dataclass(frozen=True, slots=True)
class Sample:
    """How ranges of settings are sampled.

    Parameters
    ----------
    points
        Number of points; each is driven with all seeds and all else.
    method
        `latin_hypercube`: each range is cut into as many equal parts as there are points, and each
        part has one point. `boundary`: after some such points, later ones are put where passes
        turn into failures.
    seed
        Seed of the points.
    """

    points: int
    method: Literal["latin_hypercube", "random", "boundary"] = "latin_hypercube"
    seed: int = 1

    def __post_init__(self) -> None:
        """Check the numbers."""
        for key, least in (("points", 1), ("seed", 0)):
            if getattr(self, key) < least:
                raise InvalidValue(key, f"must be at least {least}", getattr(self, key))


@dataclass(frozen=True, slots=True)
class Range:
    """A range of a setting; of whole numbers if both ends are whole."""

    key: str
    low: float
    high: float
    is_log: bool = False

    def value(self, share: float) -> float:
        """Return the value at a share from 0 to 1 of the range."""
        width = self.high - self.low
        if isinstance(self.low, int) and isinstance(self.high, int):
            return self.low + min(int(share * (width + 1)), width)
        if self.is_log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * width


@dataclass(frozen=True, slots=True)
class ListedCase:
    """One run that is given in full, `[[case]]`; keys as those of `Campaign`, one value each.

    Parameters
    ----------
    name
        Its kind in the results, which counts each: any number of cases may have the same.
    set
        Settings of this case, beside those of the file.
    criteria
        What it must fulfil to pass, in place of those of the file; empty: those.
    """

    name: str
    robot: str = "diff_drive"
    world: str = ""
    mission: str = ""
    faults: str = ""
    options: str = ""
    set: dict[str, Any] = field(default_factory=dict)
    seed: int = 1
    criteria: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the seed."""
        if self.seed < 0:
            raise InvalidValue("seed", f"must be at least 0, found {self.seed}", self.seed)

    @property
    def names(self) -> tuple[str, ...]:
        """Its value on each axis."""
        return (self.robot, self.world, self.mission, self.faults, self.options)

    def settings(self) -> dict[str, Any]:
        """Return its settings by dotted key."""
        return flat(self.set)


@dataclass(frozen=True, slots=True)
class Campaign:
    """Content of a campaign file.

    Parameters
    ----------
    robots, worlds, missions, faults
        Files or names as `robotctl sim` takes them; every one with every other. "": none, or as
        `robotctl sim` chooses.
    options
        Further options of `robotctl sim`, a text for each variant: "--localiser mcl --people 2".
    set
        Settings of the robot: a value, a list of values for a grid, or `{ from = 1, to = 2 }`, a
        range for `sample`, with `log = true` in equal ratios.
    sample
        How ranges are sampled.
    seeds
        Seeds of the simulated world: so many, or a list.
    runs
        Maximum number of runs, drawn from all; 0: all of them.
    max_seconds
        Limit of a run, in the robot's time.
    wall_seconds
        Limit of a run in the computer's time; one that takes longer is ended, without a result.
    buses
        Buses as `robotctl sim --bus` takes them, on each of which one run at a time goes in real
        time, with processors of its own; empty: all runs are in lockstep.
    criteria
        What a run must fulfil to pass.
    case
        Runs in full, in place of robots, worlds, missions, faults, options and seeds.
    """

    robots: tuple[str, ...] = ("diff_drive",)
    worlds: tuple[str, ...] = ("",)
    missions: tuple[str, ...] = ("",)
    faults: tuple[str, ...] = ("",)
    options: tuple[str, ...] = ("",)
    set: dict[str, Any] = field(default_factory=dict)
    sample: Sample | None = None
    seeds: int | tuple[int, ...] = 1
    runs: int = 0
    max_seconds: float = 300.0
    wall_seconds: float = 900.0
    buses: tuple[str, ...] = ()
    criteria: tuple[str, ...] = ("mission_completed = true", "collisions = 0", "unsafe_motions = 0")
    case: tuple[ListedCase, ...] = ()

    def __post_init__(self) -> None:
        """Check the numbers, and that no list is empty."""
        for key in ("robots", "worlds", "missions", "faults", "options", "criteria"):
            if not getattr(self, key):
                raise InvalidValue(key, "must have an entry at least", ())
        if len(set(self.buses)) < len(self.buses):
            raise InvalidValue("buses", "must have each bus once", self.buses)
        seeds = self.seeds
        if isinstance(seeds, int) and seeds < 1:
            raise InvalidValue("seeds", f"must be at least 1, found {seeds}", seeds)
        if isinstance(seeds, tuple) and (not seeds or min(seeds) < 0):
            raise InvalidValue("seeds", "must be a list of numbers from 0 on", seeds)
        for key, least in (("runs", 0), ("max_seconds", 1.0), ("wall_seconds", 1.0)):
            if not least <= getattr(self, key) < math.inf:
                found = getattr(self, key)
                raise InvalidValue(key, f"must be at least {least:g}, found {found:g}", found)

    @property
    def case_criteria(self) -> dict[str, tuple[str, ...]]:
        """Criteria of the cases that have their own, by name."""
        return {each.name: each.criteria for each in self.case if each.criteria}

    @property
    def axes(self) -> tuple[tuple[str, ...], ...]:
        """The values on each of `AXES`."""
        if self.case:
            return tuple(
                tuple(dict.fromkeys(each))
                for each in zip(*(c.names for c in self.case), strict=True)
            )
        return (self.robots, self.worlds, self.missions, self.faults, self.options)

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """All seeds."""
        return self.seeds if isinstance(self.seeds, tuple) else tuple(range(1, self.seeds + 1))

    def settings(self) -> dict[str, Any]:
        """Return the settings by dotted key: a value, a list, or a table of a range."""
        return flat(self.set)

    def grid(self) -> dict[str, list[Any]]:
        """Return the values of each setting that is no range, by dotted key."""
        found = self.settings().items()
        return {k: v if isinstance(v, list) else [v] for k, v in found if not is_range(v)}

    def ranges(self) -> tuple[Range, ...]:
        """Return the ranges."""
        return tuple(
            Range(key, table[FROM], table[TO], table.get(LOG, False))
            for key, table in self.settings().items()
            if is_range(table)
        )


def setting(key: str, value: Any) -> str:
    """Return a setting as `--set` takes it."""
    return f"{key}={_toml(value)}"


def _toml(value: Any) -> str:
    """Return a value in TOML, on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key} = {_toml(each)}' for key, each in value.items())}}}"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a table and of those inside it, by dotted key."""
    return {".".join(key): value for key, value in _leaves(table, ())}


def is_range(value: Any) -> bool:
    """Whether the value of a setting is a range."""
    return isinstance(value, Mapping) and (FROM in value or TO in value)


def _leaves(table: Mapping[str, Any], at: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the settings of a table and of those inside it."""
    for key, value in table.items():
        if isinstance(value, Mapping) and not is_range(value):
            yield from _leaves(value, (*at, key))
        else:
            yield (*at, key), value
