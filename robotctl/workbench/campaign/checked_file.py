"""Reading campaign files: every name and key is checked before the first run."""

from __future__ import annotations

import itertools
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
_FOLDERS: Final = {"robots": "", "worlds": "worlds", "missions": "missions", "faults": "scenarios"}
"""Folder of the built-in files of each axis."""
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
    names: dict[str, Any] = {
        axis: tuple(_full_name(each, folder, path.parent) for each in getattr(campaign, axis))
        for axis, folder in _FOLDERS.items()
    }
    return replace(campaign, **names)


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
    for index, text in enumerate(campaign.criteria):
        try:
            parse_condition(text)
        except ValueError as error:
            yield ("criteria", index), str(error)
    for index, text in enumerate(campaign.options):
        if problem := _option_problem(text, check_options):
            yield ("options", index), problem
    wrong = [*_wrong_ranges(campaign)]
    yield from wrong or _wrong_for_robots(campaign, beside)


def _unknown_names(campaign: Campaign, beside: Path) -> Iterator[Problem]:
    """Yield names without a file, and missions that are wrong."""
    for axis, folder in _FOLDERS.items():
        for index, name in enumerate(getattr(campaign, axis)):
            if not name and axis != "robots":
                continue
            try:
                file = _find(name, folder, beside)
                if axis == "missions":
                    load_mission(file)
            except RobotctlError as error:
                yield (axis, index), str(error)


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
    for index, name in enumerate(campaign.robots):
        robot = _find_or_none(name, "", beside)
        if robot is None:
            continue
        if problem := _problem(robot, ()):
            yield ("robots", index), problem
            continue
        for found in (*_wrong_settings(robot, values), *_wrong_faults(campaign, robot, beside)):
            if found not in said:
                yield found
            said.add(found)


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


def _wrong_faults(campaign: Campaign, robot: Path, beside: Path) -> Iterator[Problem]:
    """Yield scenarios of faults that are wrong, or that a robot cannot have."""
    for index, name in enumerate(campaign.faults):
        scenario = _find_or_none(name, "scenarios", beside)
        try:
            load_faults(SimOptions(robot, Path(), faults=scenario))
        except RobotctlError as error:
            yield ("faults", index), str(error)


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
