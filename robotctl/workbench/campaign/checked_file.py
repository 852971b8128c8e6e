"""Reading campaign files: every name and key is checked before the first run."""

from __future__ import annotations

import functools
import itertools
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeAlias

from robotctl import toml_source
from robotctl.app.processes.navigator import load_mission
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import load_faults, simulated_robot
from robotctl.config.robot_file import config_directory, find_file, load_robot
from robotctl.errors import RobotctlError
from robotctl.maps.world import find_world
from robotctl.workbench.campaign.campaign_file import (
    BOUNDARY,
    FROM,
    LOG,
    TO,
    Campaign,
    is_range,
    setting,
)
from robotctl.workbench.campaign.conditions import parse_condition

Problem: TypeAlias = tuple[toml_source.Key, str]
CheckOptions: TypeAlias = Callable[[Sequence[str]], str]
"""Returns what is wrong with options of `robotctl sim`; empty: nothing."""

_OWN_OPTIONS: Final = frozenset((
    "--robot", "--world", "--mission", "--faults", "--set", "--seed", "--max-seconds", "--lockstep",
    "--report", "--html", "--record", "--bus", "--headless", "--stay", "--until-done", "--help",
))  # fmt: skip
"""Options of `robotctl sim` that other keys give, or that no run of a campaign has."""
_FOLDERS: Final = {
    "robots": ("robot", ""),
    "worlds": ("world", "worlds"),
    "missions": ("mission", "missions"),
    "faults": ("faults", "scenarios"),
}
"""Each axis with its name in a case, and the folder of its built-in files."""
_MOST_CORNERS: Final = 64
"""Combinations of settings that are checked: some seconds."""


def load_campaign(path: Path, check_options: CheckOptions) -> Campaign:
    """Read a campaign's file and check every name and key in it.

    Files of robots, worlds, missions and faults are returned by absolute path, unless they are
    built-in.

    Raises
    ------
    ConfigError
        With one line for each error: file, line, key, what is wrong, nearest right name.
    """

    def rules(campaign: Campaign) -> Iterator[Problem]:
        yield from _problems(campaign, path.parent, check_options)

    campaign = toml_source.load(path, Campaign, rules=rules)
    full_name = functools.cache(functools.partial(_full_name, beside=path.parent))
    names: dict[str, Any] = {
        axis: tuple(full_name(each, folder) for each in getattr(campaign, axis))
        for axis, (_, folder) in _FOLDERS.items()
    }
    cases = tuple(
        replace(
            each,
            robot=full_name(each.robot, ""),
            world=full_name(each.world, "worlds"),
            mission=full_name(each.mission, "missions"),
            faults=full_name(each.faults, "scenarios"),
        )
        for each in campaign.case
    )
    return replace(campaign, case=cases, **names)


def _find(name: str, folder: str, beside: Path) -> Path:
    """Return the file of a name in a campaign's file."""
    if folder == "worlds":
        return find_world(name, beside)
    return find_file(name, folder, beside=beside).resolve()


def _full_name(name: str, folder: str, beside: Path) -> str:
    """Return a name with which `robotctl sim` finds the file from any folder."""
    if not name:
        return ""
    file = _find(name, folder, beside)
    shipped = (config_directory() / folder).resolve()
    return file.stem if file.parent == shipped and file.suffix == ".toml" else str(file)


def _problems(campaign: Campaign, beside: Path, check_options: CheckOptions) -> Iterator[Problem]:
    """Yield what is wrong with names, options, criteria and settings."""
    yield from _unknown_names(campaign, beside)
    yield from _wrong_cases(campaign)
    for key, text in _texts(campaign, "criteria"):
        try:
            parse_condition(text)
        except ValueError as error:
            yield key, str(error)
    for key, text in _texts(campaign, "options"):
        if problem := _option_problem(text, check_options):
            yield key, problem
    yield from _wrong_buses(campaign)
    wrong = [*_wrong_ranges(campaign)]
    yield from wrong or _wrong_for_robots(campaign, beside)


def _texts(campaign: Campaign, axis: str) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield the texts of a list and of the same key of all cases, each once, with its first key."""
    first: dict[str, toml_source.Key] = {}
    for index, text in enumerate(getattr(campaign, axis)):
        first.setdefault(text, (axis, index))
    key = _FOLDERS[axis][0] if axis in _FOLDERS else axis
    for number, case in enumerate(campaign.case):
        value = getattr(case, key)
        for text in (value,) if isinstance(value, str) else value:
            first.setdefault(text, ("case", number, key))
    for text, at in first.items():
        yield at, text


def _unknown_names(campaign: Campaign, beside: Path) -> Iterator[Problem]:
    """Yield names without a file, and missions that are wrong."""
    for axis, (_, folder) in _FOLDERS.items():
        for key, name in _texts(campaign, axis):
            if not name and axis != "robots":
                continue
            try:
                file = _find(name, folder, beside)
                if axis == "missions":
                    load_mission(file)
            except RobotctlError as error:
                yield key, str(error)


def _wrong_cases(campaign: Campaign) -> Iterator[Problem]:
    """Yield what contradicts the cases."""
    if not campaign.case:
        return
    for key in (*_FOLDERS, "options", "seeds"):
        if getattr(campaign, key) != getattr(Campaign(), key):
            yield (key,), "not allowed with [[case]], which has its own"
    criteria: dict[str, tuple[str, ...]] = {}
    for index, case in enumerate(campaign.case):
        if case.criteria != criteria.setdefault(case.name, case.criteria):
            problem = f"must be those of the first case named {case.name!r}"
            yield ("case", index, "criteria"), problem
        if found := next((k for k, v in case.settings().items() if is_range(v)), ""):
            yield ("case", index, "set", *found.split(".")), "must be a value: a case is one run"


def _option_problem(text: str, check_options: CheckOptions) -> str:
    """Return what is wrong with options of `robotctl sim`; empty: nothing."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        return f"{error}, found {text!r}"
    own = next((word for word in words if word.partition("=")[0] in _OWN_OPTIONS), "")
    if own:
        return f"{own} is not allowed here: the campaign itself sets it, or does without"
    return check_options(words)


def _wrong_buses(campaign: Campaign) -> Iterator[Problem]:
    """Yield buses that there cannot be, and that there are more of than processors."""
    for index, bus in enumerate(campaign.buses):
        try:
            SimOptions(Path(), Path(), bus=bus)
        except RobotctlError as error:
            yield ("buses", index), str(error).partition(": ")[2]
    processors = len(os.sched_getaffinity(0))
    if len(campaign.buses) > processors:
        yield ("buses",), f"must be {processors} at most, a processor for each run in real time"


def _wrong_ranges(campaign: Campaign) -> Iterator[Problem]:
    """Yield ranges and lists that are none, and a sample that is missing or has none."""
    settings = campaign.settings()
    tables = {key: each for key, each in settings.items() if is_range(each)}
    for key, table in tables.items():
        if problem := _range_problem(table):
            yield ("set", *key.split(".")), problem
    for key, value in settings.items():
        if value == []:
            yield ("set", *key.split(".")), "must have an entry at least"
    if tables and campaign.sample is None:
        yield ("set",), "a range needs a table [sample] with points = NUMBER"
    if campaign.sample is not None and not tables:
        yield ("sample",), "has no effect: [set] has no range"
    if campaign.sample is not None and campaign.sample.method == BOUNDARY and campaign.runs:
        yield ("runs",), f'not allowed with method = "{BOUNDARY}", which needs all its runs'


def _range_problem(table: Mapping[str, Any]) -> str:
    """Return what is wrong with a range; empty: nothing."""
    if extra := table.keys() - {FROM, TO, LOG}:
        return f"{min(extra)}: unknown key{toml_source.nearest(min(extra), [FROM, TO, LOG])}"
    if not all(_is_number(table.get(end)) for end in (FROM, TO)):
        return "a range must have numbers: { from = 1.0, to = 2.0 }"
    if not table[FROM] < table[TO]:
        return f"from must be less than to, found {table[FROM]} and {table[TO]}"
    if not isinstance(table.get(LOG, False), bool):
        return f"log must be true or false, found {table[LOG]!r}"
    if table.get(LOG) and table[FROM] <= 0:
        return f"from must be above 0 with log = true, found {table[FROM]}"
    return ""


def _wrong_for_robots(campaign: Campaign, beside: Path) -> Iterator[Problem]:
    """Yield what is wrong with a robot, with settings it does not take and faults it cannot have.

    Names that lead to no file were said before.
    """
    ends = {each.key: [each.value(0.0), each.value(1.0)] for each in campaign.ranges()}
    values = campaign.grid() | ends
    said: set[Problem] = set()
    robots: dict[str, Path] = {}
    for key, name in _texts(campaign, "robots"):
        robot = _find_or_none(name, "", beside)
        if robot is None:
            continue
        if problem := _problem(robot, ()):
            yield key, problem
            continue
        robots[name] = robot
        wrong = _wrong_settings(robot, values)
        if not campaign.case:
            wrong += _wrong_faults([*_texts(campaign, "faults")], robot, beside)
        for found in wrong:
            if found not in said:
                yield found
            said.add(found)
    checked: set[tuple[str, ...]] = set()
    for index, case in enumerate(campaign.case):
        settings = {key: [value] for key, value in case.settings().items()}
        alike = (case.robot, case.faults, repr(settings))
        if case.robot not in robots or alike in checked:
            continue
        checked.add(alike)
        for key, problem in _wrong_settings(robots[case.robot], settings):
            yield ("case", index, *key), problem
        at = ("case", index, "faults")
        yield from _wrong_faults([(at, case.faults)], robots[case.robot], beside)


def _wrong_settings(robot: Path, values: Mapping[str, Sequence[Any]]) -> list[Problem]:
    """Return settings that a robot does not take, alone or else together."""
    alone = [
        (("set", *key.split(".")), problem)
        for key, each in values.items()
        for value in each
        if (problem := _problem(robot, (setting(key, value),)))
    ]
    if alone or len(values) < 2:
        return list(dict.fromkeys(alone))
    for corner in itertools.islice(itertools.product(*values.values()), _MOST_CORNERS):
        settings = tuple(map(setting, values, corner))
        if problem := _problem(robot, settings):
            return [(("set",), f"{robot.stem} with {' '.join(settings)}: {problem}")]
    return []


def _wrong_faults(
    names: Sequence[tuple[toml_source.Key, str]], robot: Path, beside: Path
) -> list[Problem]:
    """Return scenarios of faults that are wrong, or that a robot cannot have."""
    found = []
    for key, name in names:
        scenario = _find_or_none(name, "scenarios", beside)
        try:
            load_faults(SimOptions(robot, Path(), faults=scenario))
        except RobotctlError as error:
            found.append((key, str(error)))
    return found


def _find_or_none(name: str, folder: str, beside: Path) -> Path | None:
    """Return the file of a name; None of none, or where that was said before."""
    try:
        return _find(name, folder, beside) if name else None
    except RobotctlError:
        return None


def _problem(robot: Path, settings: tuple[str, ...]) -> str:
    """Return why a robot does not take settings; empty if it does."""
    try:
        load_robot(robot, settings)
        simulated_robot(robot, settings)
    except RobotctlError as error:
        told = str(error)
        for each in settings:
            told = told.removeprefix(f"--set {each}: {each.partition('=')[0]}: ")
        return told
    return ""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
