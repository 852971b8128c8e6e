"""The BARN navigation challenge in our simulator: `tools/barn.py WORLDS.json.gz FOLDER`.

Writes its courses of cylinders into FOLDER as worlds, and `barn.toml`, with which `robotctl
campaign` drives each once from start to goal without a map. With `--score RESULTS` it scores the
folder of the results as the challenge does (Perille et al., Benchmarking Metric Ground Navigation,
SSRR 2020; rules of the ICRA challenge): success * t_opt / clip(t, 2 t_opt, 8 t_opt), where t_opt is
the length of the reference path over 2 m/s, and a collision is no success.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from case_file import write_cases, write_mission
from robotctl.workbench.campaign.results import read_folder

CASE = "BARN"
FASTEST_M_S = 2.0
SIDES = 12
"""Sides of the polygon about a cylinder: it is at most 3.6 % wider."""
MARGIN_M = 3.0
"""Free floor around the course, start and goal."""


@dataclass(frozen=True)
class Challenge:
    """What all courses share: start x, y, heading [m, m, rad], goal x, y [m], limit [s]."""

    radius_m: float
    start: tuple[float, float, float]
    goal_m: tuple[float, float]
    time_limit_s: float


@dataclass(frozen=True)
class Course:
    """One course: its number, the length of the reference path, and where cylinders stand."""

    number: int
    path_m: float
    cylinders_m: Sequence[tuple[float, float]]

    @property
    def name(self) -> str:
        """Name of its world."""
        return f"barn_{self.number:03d}"


def read(path: Path) -> tuple[Challenge, list[Course]]:
    """Read the courses."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        data = json.load(file)
    challenge = Challenge(data["radius_m"], data["start"], data["goal_m"], data["time_limit_s"])
    return challenge, [
        Course(each["world"], each["path_m"], each["cylinders_m"]) for each in data["worlds"]
    ]


def world_text(course: Course, challenge: Challenge) -> str:
    """Return the file of a course's world."""
    x_m, y_m, _ = challenge.start
    places = [*course.cylinders_m, (x_m, y_m), challenge.goal_m]
    low = [min(place[i] for place in places) - MARGIN_M for i in (0, 1)]
    high = [max(place[i] for place in places) + MARGIN_M for i in (0, 1)]
    lines = [
        "[world]",
        f'name = "{course.name}"',
        f"start = {{ x_m = {x_m:.3f}, y_m = {y_m:.3f}, heading_deg = {heading_deg(challenge)} }}",
        f"bounds = [{', '.join(f'{each:.3f}' for each in (*low, *high))}]",
    ]
    for x_m, y_m in course.cylinders_m:
        lines += [
            "",
            "[[furniture]]",
            'kind = "pillar"',
            f"centre = [{x_m:.3f}, {y_m:.3f}]",
            f"radius_m = {challenge.radius_m}",
            f"sides = {SIDES}",
        ]
    return "\n".join([*lines, ""])


def heading_deg(challenge: Challenge) -> float:
    """Return where the robot looks at the start [deg]."""
    return round(math.degrees(challenge.start[2]), 3)


def metric(*, success: bool, time_s: float, path_m: float) -> float:
    """Return the score of one run, in [0, 0.5]."""
    best_s = path_m / FASTEST_M_S
    return best_s / min(max(time_s, 2.0 * best_s), 8.0 * best_s) if success else 0.0


def case(
    course: Course, challenge: Challenge, folder: Path, robot: str = "jackal"
) -> dict[str, Any]:
    """Write world and mission of a course into a folder; return its case of a campaign there."""
    world, mission = (f"{course.name}{end}.toml" for end in ("", "_mission"))
    (folder / world).write_text(world_text(course, challenge), encoding="utf-8")
    start = (*challenge.start[:2], heading_deg(challenge))
    write_mission(folder / mission, world, start, challenge.goal_m, course.name)
    limit = f"time_s <= {challenge.time_limit_s:g}"
    return {
        "name": CASE,
        "robot": robot,
        "mission": mission,
        "options": "--localiser none",
        "criteria": ["arrived = true", "collisions = 0", limit],
    }


def score(folder: Path, courses: Iterable[Course]) -> str:
    """Return the mean score and the number of successes of the results in a folder."""
    head, results = read_folder(folder)
    paths_m = {each.name: each.path_m for each in courses}
    scores = [
        metric(
            success=head.judge(each).passed is True,
            time_s=each.report["time_s"] or 0.0,
            path_m=paths_m[each.report["mission"]],
        )
        for each in results
        if each.report is not None and each.report["mission"] in paths_m
    ]
    if not scores:
        return f"{CASE}: no results"
    successes = sum(each > 0.0 for each in scores)
    return f"{CASE}: {sum(scores) / len(scores):.4f} on average, {successes} of {len(scores)}"


def main() -> None:
    """Write courses and their campaign, or score its results."""
    parser = argparse.ArgumentParser(
        prog="tools/barn.py", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    add = parser.add_argument
    add("source", type=Path, help="the courses, .json.gz")
    add("folder", type=Path, help="for worlds, missions and the campaign's file, or --score")
    add("--robot", default="jackal", help="robot file or name (%(default)s)")
    add("--score", action="store_true", help="score the results in FOLDER")
    options = parser.parse_args()
    challenge, courses = read(options.source)
    if options.score:
        print(score(options.folder, courses))
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    file = options.folder / "barn.toml"
    write_cases(file, (case(each, challenge, options.folder, options.robot) for each in courses))
    print(f"robotctl campaign {file}")


if __name__ == "__main__":
    main()
