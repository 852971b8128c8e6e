"""Driving by places: tasks in the office without a map, a localiser or coordinates.

The map of places is made of the office's walls, furniture included; the coordinates that are kept
beside it are left out of the file. The robot is put down anywhere in a place, turned anyhow, and is
told the name of another place, not where it is. Its wheels are wrong by 1 and 0.5 %, so that its
odometry turns by 3 degrees a metre. It has arrived if it says so and truly is in that place.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy import ndimage

from benchmarks import machine
from robotctl.app.scoring.score import run_message
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.maps.topology_file import save_topology
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.topological.build import Topology, build
from robotctl.planning.map.topological.graph import TopologicalMap

WORLD: Final = "office"
TASKS: Final = 20
RADIUS_M: Final = 0.2
ROOM_M: Final = 0.35
"""Around a start."""
LONGEST_S: Final = 400.0
ODOMETRY: Final = (
    "simulation.errors.wheel_radius=[0.01, -0.005]",
    "simulation.errors.track_width=0.02",
)
CASES: Final = {"as on the map": (0, 0), "8 boxes more, 2 people": (8, 2)}
"""How much clutter, and how many people."""


class Task(NamedTuple):
    """Where a robot begins [m, m, deg], and the names of that place and of its goal."""

    start: tuple[float, float, float]
    begin: str
    goal: str


def run(_rounds: int, _seconds: float) -> None:
    """Drive all tasks of each case."""
    heads = ("office", "arrived", "elsewhere", "gave up", "collisions", "s a task", "m a task")
    rows = [(name, *drive_all(*case)) for name, case in CASES.items()]
    machine.table(f"Driving by places, {TASKS} tasks", heads, rows)


def drive_all(clutter: int, people: int, tasks: int = TASKS) -> tuple[str, ...]:
    """Return the figures of a case."""
    grid = load_localisation_map(WORLD, Path()).grid
    built = build(grid, RADIUS_M)
    arrived = elsewhere = gave_up = collisions = 0
    times_s, ways_m = [], []
    with tempfile.TemporaryDirectory() as folder:
        places = Path(folder) / "places.toml"
        save_topology(without_coordinates(built.map), places)
        for number, task in enumerate(drawn(grid, built, tasks), start=1):
            run, message = _drive(task, number, places, Path(folder), clutter, people)
            truth = run.stack.simulation.truth()
            at = built.place_at(grid, *run.stack.simulation.pose()[:2])
            name = "nowhere" if at is None else built.map.places[at].name
            is_done = run._tick.state is not None and run._tick.state.mission_completed
            arrived += is_done and name == task.goal
            elsewhere += is_done and name != task.goal
            gave_up += not is_done
            collisions += truth.collisions
            times_s.append(run.stack.clock.now_ns() * 1e-9)
            ways_m.append(truth.distance_m)
            machine.note(
                f"{number}: {task.begin} to {task.goal}: in {name} after {times_s[-1]:.0f} s, "
                f"{ways_m[-1]:.1f} m; {message}"
            )
    figures = f"{arrived} of {tasks}", elsewhere, gave_up, collisions
    return (*map(str, figures), f"{np.mean(times_s):.0f}", f"{np.mean(ways_m):.1f}")


def without_coordinates(topology: TopologicalMap) -> TopologicalMap:
    """Return the map as one that was never made of another."""
    unknown = {"x_m": math.nan, "y_m": math.nan}
    return TopologicalMap(
        tuple(replace(each, **unknown) for each in topology.places),
        tuple(replace(each, **unknown) for each in topology.passages),
    )


def drawn(grid: GridMap, built: Topology, tasks: int) -> Iterator[Task]:
    """Yield tasks, the same each time: any two places, any free spot, any heading."""
    rng = np.random.default_rng(0)
    room_m = ndimage.distance_transform_edt(grid.free()) * grid.resolution_m
    names = [place.name for place in built.map.places]
    for _ in range(tasks):
        begin, goal = rng.choice(len(names), 2, replace=False).tolist()
        cells = np.argwhere((built.labels == begin) & (room_m >= ROOM_M))
        x_m, y_m = grid.centre_of(cells[rng.integers(len(cells))][None])[0].tolist()
        start = x_m, y_m, float(rng.uniform(-180.0, 180.0))
        yield Task(start, names[begin], names[goal])


def _drive(
    task: Task, seed: int, places: Path, folder: Path, clutter: int, people: int
) -> tuple[LockstepRun, str]:
    """Drive a task; return the run and the last word."""
    x_m, y_m, heading_deg = task.start
    mission = folder / "task.toml"
    mission.write_text(
        f'name = "task"\nworld = "{WORLD}"\n'
        f"start = {{ x_m = {x_m}, y_m = {y_m}, heading_deg = {heading_deg} }}\n"
        f'[[item]]\nkind = "goto_place"\nplace = "{task.goal}"\n',
        encoding="utf-8",
    )
    run = LockstepRun(
        SimOptions(
            find_file("diff_drive"),
            mission,
            seed=seed,
            max_seconds=LONGEST_S,
            overrides=(f'navigation.pilot.topology="{places}"', *ODOMETRY),
            clutter=clutter,
            people=people,
        )
    )
    *_, (control, navigation) = run.steps()
    return run, run_message(control, navigation)
