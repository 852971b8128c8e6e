"""Missions drawn by seed among people and clutter: `tools/missions.py FOLDER`.

Writes them and `missions.toml` for `robotctl campaign`. Mission N drives from a place to another in
the flat or the office, whose map the robot knows, by turns with each drive, with a lidar and as its
file says, among 0 to 3 people and with clutter that is on no map. Each goal can be reached by what
really stands there.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from case_file import write_cases, write_mission
from firmware_sim.world.free_space import FreeSpace
from robotctl.app.scoring.best_path import best_path
from robotctl.app.simulation.room import goal_mission, load_furnished, load_room
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.maps.world import find_world
from robotctl.planning.behave.mission.mission_file import parse_mission

DRIVES = ("diff_drive", "tricycle", "ackermann")
LIDAR_BEAMS = 360
"""Gives a simulated robot a lidar; diff_drive has it."""
WORLDS = {"flat": (2.5, 8.0, 4), "office": (5.0, 14.0, 10)}
"""Least and greatest distance of a goal [m], and how much clutter there is, by world."""
MOST_PEOPLE = 3
ROOM_M = 0.55
"""Room around start and goal, by the map: the longest robot can turn there [m]."""
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

    def write(self, folder: Path) -> dict[str, Any]:
        """Write the mission into a folder; return its case of a campaign there."""
        name = f"mission_{self.number:03d}"
        write_mission(folder / f"{name}.toml", self.world, self.start, self.goal, name)
        settings = {"set": {"simulation": {"lidar": {"beams": LIDAR_BEAMS}}}} if self.lidar else {}
        return {
            "name": "missions",
            "robot": self.drive,
            "mission": f"{name}.toml",
            "options": f"--localiser mcl --people {self.people} --clutter {self.clutter}",
            "seed": self.number,
            **settings,
        }


def draw(number: int, people: int | None = None, clutter: int | None = None) -> Case:
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


def main() -> None:
    """Write missions and their campaign."""
    parser = argparse.ArgumentParser(
        prog="tools/missions.py",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, help="for missions and the campaign's file")
    add("--count", type=int, default=100, help="how many missions, from 0 on (%(default)s)")
    add("--people", type=int, help="how many in each; default: 0 to 3, drawn")
    add("--clutter", type=int, help="how much in each; default: 4 in the flat, 10 in the office")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    cases = (draw(number, options.people, options.clutter) for number in range(options.count))
    file = options.folder / "missions.toml"
    write_cases(file, (each.write(options.folder) for each in cases))
    print(f"robotctl campaign {file}")


if __name__ == "__main__":
    main()
