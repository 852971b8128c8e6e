"""The BARN navigation challenge in our simulator: `tools/barn.py WORLDS.json.gz FOLDER`.

Writes its courses of cylinders into FOLDER as worlds, drives each once in lockstep from start to
goal without a map, and scores it as the challenge does (Perille et al., Benchmarking Metric Ground
Navigation, SSRR 2020; rules of the ICRA challenge): success * t_opt / clip(t, 2 t_opt, 8 t_opt),
where t_opt is the length of the reference path over 2 m/s, and a collision is no success.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sim_runs import side_by_side, simulated

FASTEST_M_S = 2.0
SIDES = 12
"""Of the polygon about a cylinder: it is at most 3.6 % wider."""
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


@dataclass(frozen=True)
class Result:
    """How one run ended."""

    course: Course
    arrived: bool
    time_s: float
    clearance_m: float
    collisions: int
    metric: float

    def row(self) -> str:
        """Return one line of the table."""
        end = "arrived" if self.arrived else "failed"
        return (
            f"{self.course.name}  {end:7}  {self.time_s:6.1f} s  {self.clearance_m:6.3f} m  "
            f"{self.collisions} collisions  {self.metric:.3f}"
        )


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


def result(course: Course, challenge: Challenge, report: Mapping[str, Any]) -> Result:
    """Return the result of a run from its report."""
    time_s = challenge.time_limit_s if report["time_s"] is None else report["time_s"]
    clearance = report["min_clearance_m"]
    collisions = report["collisions"]
    success = bool(report["arrived"]) and not collisions and time_s <= challenge.time_limit_s
    score = metric(success=success, time_s=time_s, path_m=course.path_m)
    clearance_m = math.nan if clearance is None else clearance
    return Result(course, success, time_s, clearance_m, collisions, score)


def words_of(world: Path, challenge: Challenge, robot: str) -> list[str]:
    """Return the words of `robotctl sim` that drive a course."""
    x_m, y_m, _ = challenge.start
    goal_x_m, goal_y_m = challenge.goal_m
    return [
        *("--robot", robot, "--world", str(world)),
        *("--start", f"{x_m},{y_m},{heading_deg(challenge)}", "--goal", f"{goal_x_m},{goal_y_m}"),
        *("--localiser", "none", "--lockstep", "--headless"),
        *("--max-seconds", str(challenge.time_limit_s)),
    ]


def drive(course: Course, challenge: Challenge, options: argparse.Namespace) -> Result:
    """Write the world of a course and drive it.

    Raises
    ------
    RuntimeError
        If `robotctl sim` could not run.
    """
    world, report = (options.folder / f"{course.name}.{kind}" for kind in ("toml", "json"))
    world.write_text(world_text(course, challenge), encoding="utf-8")
    words = [*words_of(world, challenge, options.robot), *options.options]
    return result(course, challenge, simulated(words, report))


def summary(results: Iterable[Result]) -> str:
    """Return the mean score and the number of successes."""
    results = list(results)
    mean = sum(each.metric for each in results) / len(results)
    return f"{mean:.4f} on average, {sum(each.arrived for each in results)} of {len(results)}"


def main() -> int:
    """Run the command; 0 if all courses were driven, however they ended."""
    parser = argparse.ArgumentParser(
        prog="tools/barn.py", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    add = parser.add_argument
    add("source", type=Path, help="the courses, .json.gz")
    add("folder", type=Path, help="for worlds and reports")
    add("--only", default="", metavar="N,...", help="these courses; default: all")
    add("--robot", default="jackal", help="robot file or name (%(default)s)")
    add("--jobs", type=int, default=os.cpu_count(), help="runs side by side (%(default)s)")
    add("options", nargs="*", help="after --: options for robotctl sim")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    challenge, courses = read(options.source)
    if options.only:
        numbers = {int(text) for text in options.only.split(",")}
        if unknown := numbers - {each.number for each in courses}:
            listed = ", ".join(str(each.number) for each in courses)
            parser.error(f"--only: no course {min(unknown)}; there are {listed}")
        courses = [each for each in courses if each.number in numbers]
    results: list[Result] = []
    work = partial(drive, challenge=challenge, options=options)
    for done in side_by_side(work, courses, options.jobs):
        results.append(done)
        print(f"{done.row()}   {len(results)} of {len(courses)} driven", flush=True)
    print(summary(results))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
