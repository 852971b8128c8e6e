"""Missions drawn by seed among people and clutter: `tools/missions.py FOLDER`.

Mission N drives in lockstep from a place to another in the flat or the office, whose map the robot
knows, by turns with each drive, with a lidar and as its file says, among 0 to 3 people and with
clutter that is on no map. Each goal can be reached by what really stands there. Reports go into
FOLDER.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from firmware_sim.world.free_space import FreeSpace
from robotctl.app.scoring.best_path import best_path
from robotctl.app.simulation.room import goal_mission, load_furnished, load_room
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.maps.world import find_world
from robotctl.planning.behave.mission.mission_file import parse_mission
from sim_runs import side_by_side, simulated

DRIVES = ("diff_drive", "tricycle", "ackermann")
LIDAR = "simulation.lidar.beams=360"
"""Gives a simulated robot a lidar; diff_drive has it."""
WORLDS = {"flat": (2.5, 8.0, 4), "office": (5.0, 14.0, 10)}
"""Of each, the least and the greatest distance of a goal [m], and how much clutter."""
MOST_PEOPLE = 3
ROOM_M = 0.55
"""Around start and goal, by the map: the longest robot can turn there [m]."""
TRIES = 200


@dataclass(frozen=True)
class Case:
    """A mission; start is x, y, heading [m, m, deg], goal x, y [m]."""

    number: int
    world: str
    drive: str
    lidar: bool
    people: int
    clutter: int
    start: tuple[float, float, float]
    goal: tuple[float, float]

    @property
    def name(self) -> str:
        """What is driven, and where."""
        lidar = "lidar" if self.lidar else "shipped"
        return f"{self.number:3}  {self.world:6}  {self.drive:10}  {lidar:7}  {self.people} people"

    def words(self) -> list[str]:
        """Return the words of `robotctl sim` after its name."""
        start, goal = (",".join(f"{each:g}" for each in it) for it in (self.start, self.goal))
        return [
            *("--robot", self.drive, "--world", self.world, "--seed", str(self.number)),
            *("--start", start, "--goal", goal, "--localiser", "mcl"),
            *("--people", str(self.people), "--clutter", str(self.clutter)),
            *("--lockstep", "--headless", *(("--set", LIDAR) if self.lidar else ())),
        ]


def draw(number: int, people: int | None, clutter: int | None) -> Case:
    """Return a mission whose goal can be reached.

    Parameters
    ----------
    number
        Its seed.
    people, clutter
        How many; None: as drawn, and as the world says.

    Raises
    ------
    RuntimeError
        If there is no such goal.
    """
    rng = np.random.default_rng([number, 31])
    drive, world = DRIVES[number % 3], list(WORLDS)[number // 6 % 2]
    least_m, most_m, pieces = WORLDS[world]
    crowd = int(rng.integers(0, MOST_PEOPLE + 1))
    lidar = number // 3 % 2 == 0
    file = find_world(world)
    room = load_room(file)
    places = FreeSpace(room, ROOM_M, room.start[:2]).places
    robot_file = find_file(drive)
    robot = load_robot(robot_file)
    for _ in range(TRIES):
        start, goal = places[rng.choice(len(places), 2, replace=False)].round(2).tolist()
        heading_deg = float(rng.integers(-180, 180))
        if not least_m <= math.dist(start, goal) <= most_m:
            continue
        case = Case(
            number,
            world,
            drive,
            lidar,
            crowd if people is None else people,
            pieces if clutter is None else clutter,
            (*start, heading_deg),
            tuple(goal),
        )
        mission = parse_mission(goal_mission(file, case.start, case.goal), "goal.toml")
        options = SimOptions(robot_file, Path(), seed=number, clutter=case.clutter)
        try:
            furnished = load_furnished(file, options, mission)
        except ConfigError:  # no room for so much clutter
            continue
        if best_path(robot, furnished, mission.start.pose, mission) is not None:
            return case
    raise RuntimeError(f"mission {number}: no goal found")


@dataclass(frozen=True)
class Result:
    """How one run ended."""

    case: Case
    report: Mapping[str, Any]

    @property
    def arrived(self) -> bool:
        """Whether the robot arrived."""
        return bool(self.report["arrived"])

    @property
    def ratio(self) -> float:
        """Time by that of the best path; nan where the robot did not arrive."""
        if not self.arrived or self.report["time_s"] is None:
            return math.nan
        return float(self.report["time_s"] / self.report["best_s"])

    def row(self) -> str:
        """Return one line of the table."""
        r = self.report
        clearance_m = math.nan if r["min_clearance_m"] is None else r["min_clearance_m"]
        row = (
            f"{self.case.name}  {'arrived' if self.arrived else 'FAILED':7}  "
            f"{r['time_s'] or 0.0:6.1f} s  {self.ratio:5.2f}  {clearance_m:6.3f} m  "
            f"{r['collisions']} collisions, {r['ran_into']} ran into, {r['near_misses']} near, "
            f"{r['plans']} plans, {r['recoveries']} recoveries"
        )
        return row if self.arrived else f"{row}; {r['message']}"


def drive(case: Case, options: argparse.Namespace) -> Result:
    """Drive a mission.

    Raises
    ------
    RuntimeError
        If `robotctl sim` could not run.
    """
    report = options.folder / f"mission_{case.number:03d}.json"
    return Result(case, simulated([*case.words(), *options.options], report))


def summary(name: str, results: Sequence[Result]) -> str:
    """Return how many arrived, what they touched, and how long they took."""
    ratios = sorted(each.ratio for each in results if each.arrived)
    times = "no times"
    if ratios:
        p90 = ratios[max(math.ceil(0.9 * len(ratios)) - 1, 0)]
        times = f"time / best {statistics.median(ratios):.2f} in the median, {p90:.2f} p90"
    return (
        f"{name}: {len(ratios)} of {len(results)} arrived, "
        f"{sum(each.report['collisions'] for each in results)} collisions in "
        f"{sum(each.report['collisions'] > 0 for each in results)} missions, {times}"
    )


def summaries(results: Iterable[Result]) -> str:
    """Return a line for each kind of robot, and for all."""
    results = list(results)
    kinds = sorted({(each.case.drive, each.case.lidar) for each in results})
    lines = [
        summary(
            f"{drive}, {'lidar' if lidar else 'shipped'}",
            [each for each in results if (each.case.drive, each.case.lidar) == (drive, lidar)],
        )
        for drive, lidar in kinds
    ]
    return "\n".join([*lines, summary("all", results)])


def main() -> int:
    """Run the command; 0 if all missions were driven, however they ended."""
    parser = argparse.ArgumentParser(
        prog="tools/missions.py",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, help="for reports")
    add("--count", type=int, default=24, help="how many missions, from 0 on (%(default)s)")
    add("--only", default="", metavar="N,...", help="these instead")
    add("--people", type=int, help="how many in each; default: 0 to 3, drawn")
    add("--clutter", type=int, help="how much in each; default: 4 in the flat, 10 in the office")
    add("--jobs", type=int, default=os.cpu_count(), help="runs side by side (%(default)s)")
    add("--show", action="store_true", help="print the commands and run nothing")
    add("options", nargs="*", help="after --: options for robotctl sim")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    numbers = [int(text) for text in options.only.split(",") if text] or range(options.count)
    cases = [draw(number, options.people, options.clutter) for number in numbers]
    if options.show:
        for case in cases:
            print(f"robotctl sim {' '.join(case.words())}")
        return 0
    results: list[Result] = []
    for done in side_by_side(partial(drive, options=options), cases, options.jobs):
        results.append(done)
        print(f"{done.row()}   {len(results)} of {len(cases)}", flush=True)
    print(summaries(results))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
