"""Missions drawn by seed among people and clutter: `tools/missions.py FOLDER`.

Writes them and `missions.toml` for `robotctl campaign`. Mission N drives from a place to another in
a world whose map the robot knows, by turns with each drive, with a lidar and as its file says,
among people and with clutter that is on no map. Each goal can be reached by what really stands
there. `--manner each` has all who walk in one manner, by turns each and mixed.
"""

from __future__ import annotations

import argparse
import math
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from case_file import write_cases, write_mission
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.manner import MIXED, Manner, parse_manners
from robotctl.app.scoring.best_path import best_path
from robotctl.app.simulation.room import goal_mission, load_furnished, load_room
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.maps.world import find_world
from robotctl.planning.behave.mission.mission_file import parse_mission

DRIVES = ("diff_drive", "tricycle", "ackermann")
HAVE_LIDAR = ("diff_drive",)
"""Drives whose file has a lidar, so that they have one in every mission."""
LIDAR_BEAMS = 360
"""Gives a simulated robot a lidar."""
WORLDS = {
    "flat": (2.5, 8.0, 4, 0.55),
    "office": (5.0, 14.0, 10, 0.55),
    "depot": (5.0, 14.0, 6, 0.55),
    "corridor_loop": (4.0, 12.0, 4, 0.55),
    "warehouse": (5.0, 14.0, 6, 0.55),
    "tb3_sandbox": (2.5, 5.0, 2, 0.35),
}
"""Of each world: minimum and maximum distance of a goal [m], number of pieces of clutter, and room
around start and goal, by the map [m]. In 0.55 m the longest robot can turn."""
MAPS = ("warehouse", "tb3_sandbox")
"""Worlds that are ROS maps, in the folder `maps` of $ROBOTCTL_DATA."""
USUAL = ("flat", "office")
"""Worlds, unless others are asked for."""
EACH = "each"
MANNERS = (*(manner.value for manner in Manner), MIXED)
USUAL_PEOPLE = (0, 3)
TRIES = 200


@dataclass(frozen=True)
class Crowd:
    """Who walks and what stands about.

    Attributes
    ----------
    people
        Least and greatest number of people, drawn.
    clutter
        How much; None: as the world says.
    manner
        Manner of the people, as `robotctl sim --manner`, or `each`.
    """

    people: tuple[int, int] = USUAL_PEOPLE
    clutter: int | None = None
    manner: str = Manner.STUBBORN.value

    def manner_of(self, turn: int) -> str:
        """Return the manner of the people of a mission."""
        return MANNERS[turn % len(MANNERS)] if self.manner == EACH else self.manner


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
    manner: str = Manner.STUBBORN.value

    def write(self, folder: Path) -> dict[str, Any]:
        """Write the mission into a folder; return its case of a campaign there."""
        name = f"mission_{self.number:03d}"
        world = str(world_file(self.world)) if self.world in MAPS else self.world
        write_mission(folder / f"{name}.toml", world, self.start, self.goal, name)
        settings = {"set": {"simulation": {"lidar": {"beams": LIDAR_BEAMS}}}} if self.lidar else {}
        is_usual = self.manner == Manner.STUBBORN or not self.people
        manner = "" if is_usual else f" --manner {self.manner}"
        return {
            "name": "missions",
            "robot": self.drive,
            "mission": f"{name}.toml",
            "options": f"--localiser mcl --people {self.people}{manner} --clutter {self.clutter}",
            "seed": self.number,
            **settings,
        }

    @property
    def kind(self) -> str:
        """What it is counted with: manner, and sensor."""
        has_lidar = self.lidar or self.drive in HAVE_LIDAR
        return f"{self.manner}, {'lidar' if has_lidar else 'sonars'}"


def world_file(world: str) -> Path:
    """Return the file of a world.

    Raises
    ------
    ConfigError
        If it is a map that is not there.
    """
    if world not in MAPS:
        return find_world(world)
    data = os.environ.get("ROBOTCTL_DATA")
    file = Path(data or "", "maps", f"{world}.yaml")
    if data is None or not file.exists():
        missing = "$ROBOTCTL_DATA is not set" if data is None else f"no {file}"
        raise ConfigError(f"world {world}: {missing}; needed is a folder with maps/{world}.yaml")
    return file


def draw(number: int, crowd: Crowd = Crowd(), worlds: tuple[str, ...] = USUAL) -> Case:
    """Return a mission whose goal can be reached.

    Parameters
    ----------
    number
        Its seed.
    crowd
        Who walks and what stands about.
    worlds
        Worlds, by turns.

    Raises
    ------
    RuntimeError
        If there is no such goal.
    """
    rng = np.random.default_rng([number, 31])
    turn = number // 6
    drive, world = DRIVES[number % 3], worlds[turn % len(worlds)]
    manner = crowd.manner_of(turn + turn // math.lcm(len(worlds), len(MANNERS)))
    least_m, most_m, pieces, room_m = WORLDS[world]
    fewest, most = crowd.people
    people = int(rng.integers(fewest, most + 1))
    lidar = number // 3 % 2 == 0
    file = world_file(world)
    room = load_room(file)
    places = FreeSpace(room, room_m, room.start[:2]).places
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
            people,
            pieces if crowd.clutter is None else crowd.clutter,
            (*start, heading_deg),
            tuple(goal),
            manner,
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


def parse_people(text: str) -> tuple[int, int]:
    """Return the least and the greatest number of `3` or `3..6`."""
    least, dots, most = text.partition("..")
    parts = (least, most if dots else least)
    if not all(part.isascii() and part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number nor two as in 3..6")
    low, high = map(int, parts)
    if low > high:
        raise argparse.ArgumentTypeError(f"{text!r}: the first is the smaller one")
    return low, high


def parse_worlds(text: str) -> tuple[str, ...]:
    """Return the names of worlds, which are separated by commas."""
    names = tuple(text.split(","))
    for name in names:
        if name not in WORLDS:
            raise argparse.ArgumentTypeError(f"{name!r}: allowed are {', '.join(WORLDS)}")
        try:
            world_file(name)
        except ConfigError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
    return names


def parse_manner(text: str) -> str:
    """Return a manner, as `robotctl sim` has it, or `each`."""
    if text != EACH:
        parse_manners(text)
    return text


def main() -> None:
    """Write missions and their campaign."""
    parser = argparse.ArgumentParser(
        prog="tools/missions.py",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, help="for missions and the campaign's file")
    add("--first", type=int, default=0, help="number of the first mission (%(default)s)")
    add("--count", type=int, default=100, help="how many missions (%(default)s)")
    add("--people", type=parse_people, default=USUAL_PEOPLE, help="3, or 3..6; default: 0..3")
    add("--manner", type=parse_manner, default="stubborn", help="as of robotctl sim, or each")
    add("--clutter", type=int, help="how much in each; default: 2 to 10, as the world has it")
    worlds = ",".join(USUAL)
    add("--worlds", type=parse_worlds, default=USUAL, help=f"of {','.join(WORLDS)}; {worlds}")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    crowd = Crowd(options.people, options.clutter, options.manner)
    numbers = range(options.first, options.first + options.count)
    with ProcessPoolExecutor() as pool:
        cases = list(pool.map(partial(draw, crowd=crowd, worlds=options.worlds), numbers))
    file = options.folder / "missions.toml"
    write_cases(file, ({**each.write(options.folder), "name": each.kind} for each in cases))
    print(f"robotctl campaign {file}")


if __name__ == "__main__":
    main()
