"""The runs of a campaign, in order: each a command line of `robotctl sim`."""

from __future__ import annotations

import hashlib
import itertools
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc  # type: ignore[import-untyped]

from robotctl.app.processes.navigator import load_mission
from robotctl.config.robot_file import find_file
from robotctl.maps.world import find_world
from robotctl.workbench.campaign.campaign_file import Campaign, Range, Sample, setting

SEED: Final = "seed"
AXES: Final = ("robot", "world", "mission", "faults", "options")
"""Factors beside settings and the seed."""
LIMIT: Final = "--max-seconds"
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
    """Return all runs: every combination with the first seed, then with the next."""
    axes = (
        campaign.robots,
        campaign.worlds,
        campaign.missions,
        campaign.faults,
        campaign.options,
    )
    grid = campaign.grid()
    combinations = [
        (*chosen, dict(zip(grid, values, strict=True)) | point)
        for *chosen, values, point in itertools.product(
            *axes, [*itertools.product(*grid.values())], sampled(campaign.ranges(), campaign.sample)
        )
    ]
    all_runs = [(*combination, seed) for seed in campaign.all_seeds for combination in combinations]
    if 0 < campaign.runs < len(all_runs):
        chosen_ones = np.random.default_rng(0).permutation(len(all_runs))[: campaign.runs]
        all_runs = [all_runs[index] for index in np.sort(chosen_ones)]
    return tuple(
        _run(number, each, campaign.max_seconds) for number, each in enumerate(all_runs, 1)
    )


def sampled(ranges: Sequence[Range], sample: Sample | None) -> list[dict[str, Any]]:
    """Return the points of a sample, each a value for each range; one without values if none."""
    if sample is None or not ranges:
        return [{}]
    return [
        {
            each.key: _rounded(each.value(float(share)))
            for each, share in zip(ranges, row, strict=True)
        }
        for row in _shares(len(ranges), sample)
    ]


def _shares(dimensions: int, sample: Sample) -> NDArray[np.float64]:
    """Return points in the unit cube, (points, dimensions)."""
    rng = np.random.default_rng(sample.seed)
    if sample.method == "random":
        return rng.random((sample.points, dimensions))
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(sample.points))


def _rounded(value: float) -> float:
    return value if isinstance(value, int) else float(f"{value:.{_FIGURES}g}")


def words_of(
    names: Sequence[str], settings: Mapping[str, Any], seed: int, max_seconds: float
) -> tuple[str, ...]:
    """Return the arguments of `robotctl` for a run; `names`: its value on each axis."""
    words = ["sim", "--lockstep"]
    for axis, name in zip(AXES, names, strict=True):
        if axis == "options":
            words += shlex.split(name)
        elif name:
            words += [f"--{axis}", name]
    for key, value in settings.items():
        words += ["--set", setting(key, value)]
    return (*words, LIMIT, f"{max_seconds:g}", "--seed", str(seed))


def briefly(words: Sequence[str]) -> tuple[str, ...]:
    """Return the arguments of a run for one that ends as soon as it has begun."""
    at = words.index(LIMIT) + 1
    return (*words[:at], "1", *words[at + 1 :])


def _run(number: int, chosen: Sequence[Any], max_seconds: float) -> Run:
    """Return a run of its values on the axes, settings and seed."""
    *names, settings, seed = chosen
    shown = (Path(name).stem if name.startswith("/") else name for name in names)
    factors = dict(zip(AXES, shown, strict=True)) | settings | {SEED: seed}
    return Run(number, factors, words_of(names, settings, seed, max_seconds))


def files_of(campaign: Campaign) -> list[Path]:
    """Return the files that a campaign names, and the worlds of its missions."""
    missions = [find_file(name, "missions") for name in campaign.missions if name]
    named = [(load_mission(each).world, each.parent) for each in missions]
    worlds = [find_world(name) for name in campaign.worlds if name]
    worlds += [find_world(name, beside) for name, beside in named if name]
    robots = [find_file(name) for name in campaign.robots]
    faults = [find_file(name, "scenarios") for name in campaign.faults if name]
    return [*robots, *missions, *dict.fromkeys(worlds), *faults]


def fingerprint(runs: Sequence[Run], files: Sequence[Path]) -> str:
    """Return a hash of all commands of a campaign and of the files that it names."""
    found = hashlib.sha256(msgspec.json.encode([each.words for each in runs]))
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
