"""The runs of a campaign, in order: each a command line of `robotctl sim`."""

from __future__ import annotations

import hashlib
import itertools
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc  # type: ignore[import-untyped]

from robotctl.app.processes.navigator import load_mission
from robotctl.config.robot_file import find_file
from robotctl.maps.world import find_world
from robotctl.workbench.campaign.campaign_file import (
    AXES,
    BATCH,
    BOUNDARY,
    Campaign,
    Range,
    Sample,
    setting,
)

CASE, SEED = "case", "seed"
"""Further factors: name of a case, and the seed."""
LIMIT, BUS = "--max-seconds", "--bus"
"""Options of `robotctl sim`."""
_FIGURES: Final = 9
"""Significant figures of a sampled value."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run.

    Attributes
    ----------
    number
        From 1 on.
    factors
        What distinguishes it from others: its value on each axis, of each setting, and its seed.
    words
        Arguments of `robotctl`.
    """

    number: int
    factors: Mapping[str, Any]
    words: tuple[str, ...]

    @property
    def command(self) -> str:
        """The command that drives it again."""
        return command_of(self.words)


def command_of(words: Sequence[str]) -> str:
    """Return the command with these arguments, to be given to a shell."""
    return shlex.join(("robotctl", *words))


def plan(campaign: Campaign) -> tuple[Run, ...]:
    """Return all runs: every combination with the first seed, then with the next.

    Of a search they are those of its first batch.
    """
    runs = runs_at(campaign, sampled(campaign.ranges(), campaign.sample))
    if not 0 < campaign.runs < len(runs):
        return runs
    drawn = np.sort(np.random.default_rng(0).permutation(len(runs))[: campaign.runs])
    return tuple(replace(runs[index], number=number) for number, index in enumerate(drawn, 1))


def runs_at(
    campaign: Campaign, points: Sequence[Mapping[str, Any]], first: int = 1
) -> tuple[Run, ...]:
    """Return the runs at some points of the ranges, with numbers from `first` on."""
    grid = campaign.grid()
    settings = [
        {**dict(zip(grid, values, strict=True)), **point}
        for values, point in itertools.product([*itertools.product(*grid.values())], points)
    ]
    chosen: list[tuple[str, Sequence[str], Mapping[str, Any], int]]
    if campaign.case:
        chosen = [
            (each.name, each.names, {**common, **each.settings()}, each.seed)
            for each, common in itertools.product(campaign.case, settings)
        ]
    else:
        kinds = itertools.product(*campaign.axes)
        chosen = [
            ("", names, common, seed)
            for seed, names, common in itertools.product(campaign.all_seeds, kinds, settings)
        ]
    limit_s, bus = campaign.max_seconds, next(iter(campaign.buses), "")
    return tuple(_run(n, *each, limit_s, bus) for n, each in enumerate(chosen, first))


def runs_in_all(campaign: Campaign) -> int:
    """Return the number of runs, with all batches of a search."""
    planned, sample = len(plan(campaign)), campaign.sample
    if sample is None or sample.method != BOUNDARY:
        return planned
    return planned // min(sample.points, BATCH) * sample.points


def sampled(ranges: Sequence[Range], sample: Sample | None) -> list[dict[str, Any]]:
    """Return the points of a sample, each a value for each range; one without values if none."""
    if sample is None or not ranges:
        return [{}]
    return values_at(ranges, unit_points(len(ranges), sample))


def values_at(ranges: Sequence[Range], points: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Return the values of ranges at points of the unit cube."""
    return [
        {
            each.key: _rounded(each.value(float(share)))
            for each, share in zip(ranges, row, strict=True)
        }
        for row in points
    ]


def unit_points(dimensions: int, sample: Sample) -> NDArray[np.float64]:
    """Return points in the unit cube, (points, dimensions); of a search, its first batch."""
    rng = np.random.default_rng(sample.seed)
    if sample.method == "random":
        return rng.random((sample.points, dimensions))
    count = min(sample.points, BATCH) if sample.method == BOUNDARY else sample.points
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(count))


def _rounded(value: float) -> float:
    return value if isinstance(value, int) else float(f"{value:.{_FIGURES}g}")


def words_of(
    names: Sequence[str],
    settings: Mapping[str, Any],
    seed: int,
    max_seconds: float,
    bus: str = "",
) -> tuple[str, ...]:
    """Return the arguments of `robotctl` for a run.

    Parameters
    ----------
    names
        Its value on each axis.
    settings, seed, max_seconds
        As in `Campaign`.
    bus
        Bus of a run in real time; empty: in lockstep.
    """
    words = ["sim", *(["--headless", BUS, bus] if bus else ["--lockstep"])]
    for axis, name in zip(AXES, names, strict=True):
        if axis == "options":
            words += shlex.split(name)
        elif name:
            words += [f"--{axis}", name]
    for key, value in settings.items():
        words += ["--set", setting(key, value)]
    return (*words, LIMIT, f"{max_seconds:g}", "--seed", str(seed))


def on_bus(words: Sequence[str], bus: str) -> tuple[str, ...]:
    """Return the arguments of a run in real time for another bus."""
    at = words.index(BUS) + 1
    return (*words[:at], bus, *words[at + 1 :])


def briefly(words: Sequence[str]) -> tuple[str, ...]:
    """Return the arguments of a run for one that ends as soon as it has begun."""
    at = words.index(LIMIT) + 1
    return (*words[:at], "1", *words[at + 1 :])


def _run(
    number: int,
    case: str,
    names: Sequence[str],
    settings: Mapping[str, Any],
    seed: int,
    max_seconds: float,
    bus: str,
) -> Run:
    """Return a run of its values on the axes, settings and seed; `case`: empty without cases."""
    shown = (Path(name).stem if name.startswith("/") else name for name in names)
    factors: dict[str, Any] = {CASE: case} if case else {}
    factors |= {**dict(zip(AXES, shown, strict=True)), **settings, SEED: seed}
    return Run(number, factors, words_of(names, settings, seed, max_seconds, bus))


def files_of(campaign: Campaign) -> list[Path]:
    """Return the files that a campaign names, and the worlds of its missions."""
    robot_names, world_names, mission_names, fault_names, _ = campaign.axes
    missions = [find_file(name, "missions") for name in mission_names if name]
    named = [(load_mission(each).world, each.parent) for each in missions]
    worlds = [find_world(name) for name in world_names if name]
    worlds += [find_world(name, beside) for name, beside in named if name]
    robots = [find_file(name) for name in robot_names]
    faults = [find_file(name, "scenarios") for name in fault_names if name]
    return [*robots, *missions, *dict.fromkeys(worlds), *faults]


def fingerprint(campaign: Campaign, files: Sequence[Path]) -> str:
    """Return a hash of all commands of a campaign and of the files that it names."""
    content: list[Any] = [each.words for each in plan(campaign)]
    if campaign.sample is not None and campaign.sample.method == BOUNDARY:
        # The later commands depend on what passes.
        content += [campaign.sample, campaign.ranges(), campaign.criteria, campaign.case_criteria]
    found = hashlib.sha256(msgspec.json.encode(content))
    for file in files:
        found.update(file.read_bytes())
    return found.hexdigest()


def sources_fingerprint() -> str:
    """Return a hash of the sources of robotctl and of the simulator."""
    import firmware_sim  # noqa: PLC0415 - only its place
    import native_kernels  # noqa: PLC0415
    import robotctl  # noqa: PLC0415

    found = hashlib.sha256()
    for package in (robotctl, firmware_sim, native_kernels):
        folder = Path(package.__path__[0])
        for file in sorted(folder.rglob("*.py")):
            if "node_modules" not in file.parts:
                found.update(f"{file.relative_to(folder)}\n".encode())
                found.update(file.read_bytes())
    return found.hexdigest()
