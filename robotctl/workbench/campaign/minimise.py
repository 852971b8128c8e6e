"""Failures made small: the same seed, a shorter mission, fewer faults, fewer settings moved.

Each is kept in a corpus, a folder of campaign files of one run, with what it needs beside it.
"""

from __future__ import annotations

import os
import shlex
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

import tomlkit

from robotctl.config.robot_file import config_directory, find_file
from robotctl.maps.world import find_world
from robotctl.runtime.storage.atomic_file import write_whole
from robotctl.words import counted
from robotctl.workbench.campaign.alone import Ending
from robotctl.workbench.campaign.campaign_file import AXES, Campaign
from robotctl.workbench.campaign.conditions import Condition, read_report
from robotctl.workbench.campaign.plan import CASE, SEED, words_of
from robotctl.workbench.campaign.results import Head, Result, judge
from robotctl.workbench.campaign.statistics import Judged

T = TypeVar("T")
RunWords: TypeAlias = Callable[[Sequence[str]], Ending]
"""Runs `robotctl WORDS` alone."""
FILES: Final = "files"
"""Folder of a corpus with missions and scenarios."""


@dataclass(frozen=True, slots=True)
class Case:
    """A run that fails, in parts that can be left out.

    Attributes
    ----------
    names
        Robot, world, mission, faults and options; the files of mission and faults are replaced by
        what is left of them.
    settings
        Settings by key.
    seed, max_seconds
        Those of the run.
    mission, scenario
        Content of the files of mission and faults; None where there is none.
    """

    names: Mapping[str, str]
    settings: Mapping[str, Any]
    seed: int
    max_seconds: float
    mission: Mapping[str, Any] | None
    scenario: Mapping[str, Any] | None

    @property
    def items(self) -> int:
        """Number of steps of the mission."""
        return len(self.mission["item"]) if self.mission else 0

    @property
    def faults(self) -> int:
        """Number of faults."""
        return len(self.scenario["fault"]) if self.scenario else 0


def alike(failures: Iterable[Judged], head: Head) -> list[list[Judged]]:
    """Return failures in groups: the same robot, world, mission and faults violate the same."""
    groups: dict[tuple[Any, ...], list[Judged]] = {}
    for each in failures:
        names = tuple(each.result.factors.get(axis, "") for axis in AXES)
        broken = _broken(each.result, head.conditions_of(each.result))
        groups.setdefault((*names, broken), []).append(each)
    return [*groups.values()]


def case_of(campaign: Campaign, result: Result) -> Case:
    """Return the run of a result as a case."""
    words = [*result.words]
    names = {axis: _option(words, axis) for axis in AXES if axis != "options"}
    names["options"] = result.factors.get("options", "")
    settings = {
        key: value for key, value in result.factors.items() if key not in {*AXES, CASE, SEED}
    }
    mission = _table(names["mission"], "missions")
    return Case(
        names,
        settings,
        result.factors[SEED],
        campaign.max_seconds,
        None if mission is None else _with_own_world(mission, names["mission"]),
        _table(names["faults"], "scenarios"),
    )


def minimised(
    case: Case, conditions: Sequence[Condition], result: Result, run: RunWords
) -> tuple[Case, int]:
    """Return the smallest case found that violates a condition which the run violates, too.

    Also returns how many runs that took.
    """
    wanted, count = _broken(result, conditions), 0

    def fails(candidate: Case) -> bool:
        nonlocal count
        count += 1
        with tempfile.TemporaryDirectory(prefix="robotctl-case-") as folder:
            ending = run(_words(candidate, Path(folder)))
        if not ending.report:
            return False
        found = Result(0, {}, (), read_report(ending.report))
        return bool(wanted & _broken(found, conditions))

    for shorter in (_fewer_faults, _fewer_settings, _fewer_items, _fewer_waypoints):
        case = shorter(case, fails)
    return case, count


def ddmin(parts: Sequence[T], fails: Callable[[Sequence[T]], bool]) -> list[T]:
    """Return parts of which none can be left out alone, so that all together still fail.

    By delta debugging, Zeller and Hildebrandt (2002), without the first step into halves that are
    kept: complements alone. The parts as given fail.
    """
    kept, pieces = [*parts], 2
    if kept and fails([]):
        return []
    while len(kept) > 1:
        size = -(-len(kept) // pieces)
        for start in range(0, len(kept), size):
            rest = kept[:start] + kept[start + size :]
            if rest and fails(rest):
                kept, pieces = rest, max(pieces - 1, 2)
                break
        else:
            if size == 1:
                break
            pieces = min(2 * pieces, len(kept))
    return kept


def _fewer_settings(case: Case, fails: Callable[[Case], bool]) -> Case:
    def with_settings(kept: Sequence[tuple[str, Any]]) -> Case:
        return replace(case, settings=dict(kept))

    return with_settings(ddmin([*case.settings.items()], lambda kept: fails(with_settings(kept))))


def _fewer_faults(case: Case, fails: Callable[[Case], bool]) -> Case:
    def with_faults(kept: Sequence[Any]) -> Case:
        scenario = {**case.scenario, "fault": [*kept]} if case.scenario and kept else None
        return replace(case, scenario=scenario)

    if case.scenario is None:
        return case
    return with_faults(ddmin(case.scenario["fault"], lambda kept: fails(with_faults(kept))))


def _fewer_items(case: Case, fails: Callable[[Case], bool]) -> Case:
    def with_items(kept: Sequence[Any]) -> Case:
        return replace(case, mission={**(case.mission or {}), "item": [*kept]})

    if case.mission is None:
        return case
    items = ddmin(case.mission["item"], lambda kept: bool(kept) and fails(with_items(kept)))
    return with_items(items)


def _fewer_waypoints(case: Case, fails: Callable[[Case], bool]) -> Case:
    """Return a case whose last path ends as early as it still fails."""

    def to(end: int) -> Case:
        mission = case.mission or {}
        last = {**mission["item"][-1], "waypoints": points[:end]}
        return replace(case, mission={**mission, "item": [*mission["item"][:-1], last]})

    points = case.mission["item"][-1].get("waypoints", []) if case.mission else []
    low, high = 1, len(points)  # `high` fails; a path has two points at least
    if high <= 2:
        return case
    while high - low > 1:
        middle = (low + high) // 2
        if fails(to(middle)):
            high = middle
        else:
            low = middle
    return to(high) if high < len(points) else case


def keep(corpus: Path, name: str, case: Case, criteria: Sequence[str], comment: str) -> Path:
    """Write a case into a corpus; return its file, a campaign of one run."""
    files = corpus / FILES
    files.mkdir(parents=True, exist_ok=True)
    names = dict(case.names)
    if case.mission is not None:
        mission = dict(case.mission)
        if world := mission.get("world"):
            mission["world"] = _relative(world, files)
        names["mission"] = f"{FILES}/{name}-mission.toml"
        write_whole(corpus / names["mission"], tomlkit.dumps(mission))
    names["faults"] = ""
    if case.scenario is not None:
        names["faults"] = f"{FILES}/{name}-faults.toml"
        write_whole(corpus / names["faults"], tomlkit.dumps(case.scenario))
    for axis in ("robot", "world"):
        names[axis] = _relative(names[axis], corpus)
    content: dict[str, Any] = {
        ("faults" if axis == "faults" else "options" if axis == "options" else f"{axis}s"): [each]
        for axis, each in names.items()
        if each
    }
    content |= {"seeds": [case.seed], "max_seconds": case.max_seconds, "criteria": [*criteria]}
    document = tomlkit.document()
    for line in comment.splitlines():
        document.add(tomlkit.comment(line))
    for key, value in content.items():
        document.add(key, value)
    if case.settings:
        table = tomlkit.table()
        for key, value in case.settings.items():
            table.append(tomlkit.key(key.split(".")), [value])
        document.add("set", table)
    file = corpus / f"{name}.toml"
    write_whole(file, tomlkit.dumps(document))
    return file


def _broken(result: Result, conditions: Iterable[Condition]) -> frozenset[str]:
    """Return the conditions that a result violates."""
    return frozenset(str(each) for each in conditions if judge(result, (each,)).passed is False)


def _words(case: Case, folder: Path) -> tuple[str, ...]:
    """Return the arguments of `robotctl` that drive a case, whose files are written to a folder."""
    names = dict(case.names)
    for axis, content in (("mission", case.mission), ("faults", case.scenario)):
        names[axis] = ""
        if content is not None:
            file = folder / f"{axis}.toml"
            file.write_text(tomlkit.dumps(content), encoding="utf-8")
            names[axis] = str(file)
    chosen = [names[axis] for axis in AXES]
    return words_of(chosen, case.settings, case.seed, case.max_seconds)


def _option(words: Sequence[str], axis: str) -> str:
    """Return the value of an option; empty without it."""
    option = f"--{axis}"
    return words[words.index(option) + 1] if option in words else ""


def _table(name: str, folder: str) -> dict[str, Any] | None:
    """Return the content of a file; None of no name."""
    if not name:
        return None
    text = find_file(name, folder).read_text(encoding="utf-8-sig")
    return tomlkit.parse(text).unwrap()


def _with_own_world(mission: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a mission whose world is found from any folder."""
    if not mission.get("world"):
        return mission
    beside = find_file(name, "missions").parent
    world = find_world(mission["world"], beside)
    shipped = (config_directory() / "worlds").resolve()
    return {**mission, "world": world.stem if world.parent == shipped else str(world)}


def _relative(name: str, folder: Path) -> str:
    """Return the path of a file seen from a folder; a built-in name as it is."""
    return os.path.relpath(name, folder.resolve()) if name.startswith("/") else name


def shown_case(case: Case) -> str:
    """Return a case for people."""
    settings = shlex.join(f"{key}={value}" for key, value in case.settings.items())
    points = sum(len(each.get("waypoints", ())) for each in (case.mission or {}).get("item", ()))
    parts = (
        counted(case.items, "mission item"),
        counted(points, "waypoint"),
        counted(case.faults, "fault"),
        f"settings: {settings or 'none'}",
    )
    return ", ".join(parts)
