"""A ROS map as a world beside walls of TOML: what sensors, pictures and a whole run cost.

The flat is driven as it comes, and as a map of 3 cm cells that `robotctl` made of it; with
ROBOTCTL_DATA also nav2's warehouse, 30 m by 50 m. All of one round is measured in turn.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks import machine
from firmware_sim.camera.camera import Camera
from firmware_sim.config.config import load_robot
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.world.world import World, load_world
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.room import straight_mission
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.maps.map_file import save_map
from robotctl.maps.world import load_walls

ROBOT = find_file("diff_drive")
POSES = 200
PICTURES = 20


def run(rounds: int, _seconds: float) -> None:
    """Measure each world in each round, in turn."""
    with tempfile.TemporaryDirectory() as folder:
        worlds = list(_worlds(Path(folder)))
        found: list[list[tuple[float, ...]]] = [[] for _ in worlds]
        for path, mission in worlds:
            _measured(path, mission)
        for _ in range(rounds):
            for rows, (path, mission) in zip(found, worlds, strict=True):
                rows.append(_measured(path, mission))
        table = [
            (path.name, str(len(load_world(path).segments)), *_columns(rows))
            for rows, (path, _) in zip(found, worlds, strict=True)
        ]
    heads = ("world", "walls", "load ms", "scan us", "sonar us", "picture ms", "x real time")
    machine.table(
        "ROS maps as worlds: 360 beams to 12 m, four sonars to 4 m, 640 x 480, a run in lockstep",
        heads,
        table,
    )


def _worlds(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Yield worlds and the missions in them."""
    flat, patrol = find_file("flat", "worlds"), find_file("patrol", "missions")
    yield flat, patrol
    save_map(folder / "flat_3cm", grid_of_walls(load_walls(flat), 0.03))
    yield folder / "flat_3cm.yaml", patrol
    warehouse = Path(os.environ.get("ROBOTCTL_DATA", "")) / "maps" / "warehouse.yaml"
    if not warehouse.is_file():
        machine.note(f"not measured, there is no {warehouse}; see ROBOTCTL_DATA")
        return
    mission = folder / "straight.toml"
    mission.write_text(straight_mission(warehouse), encoding="utf-8")
    yield warehouse, mission


def _measured(path: Path, mission: Path) -> tuple[float, ...]:
    """Return seconds to load, of a scan, of four sonars, of a picture; and times real time."""
    begin_s = time.process_time()
    world = load_world(path)
    loaded_s = time.process_time() - begin_s
    config, rng = load_robot(ROBOT), np.random.default_rng(1)
    lidar = next(iter(config.simulation.lidars), None)
    if lidar is None:
        raise AssertionError("the default robot has one")
    scan, ring, camera = (
        Lidar(lidar, world, rng),
        SonarRing(config, world, rng),
        Camera(config, world),
    )
    poses = _poses(world)
    options = SimOptions(ROBOT, mission, str(path), localisation=("localisation.mapping=true",))
    drive = LockstepRun(options)
    begin_s = time.process_time()
    driven_s = drive.run().duration_s
    factor = driven_s / (time.process_time() - begin_s)
    return (
        loaded_s,
        _seconds_each(scan.scan, poses),
        _seconds_each(lambda *pose: ring.fire(0, *pose), poses),
        _seconds_each(camera.look, poses[:PICTURES]),
        factor,
    )


def _poses(world: World) -> list[tuple[float, float, float]]:
    """Draw places in the world, walls or not, the nearest to its start."""
    near = world.places(*world.start[:2])[: 40 * POSES]
    chosen = np.random.default_rng(2).choice(near, POSES)
    return [(x, y, math.remainder(k, math.tau)) for k, (x, y) in enumerate(chosen.tolist())]


def _seconds_each(
    look: Callable[[float, float, float], object], poses: list[tuple[float, float, float]]
) -> float:
    for pose in poses:  # the first look from a place chooses the walls that are near it
        look(*pose)
    begin_s = time.process_time()
    for pose in poses:
        look(*pose)
    return (time.process_time() - begin_s) / len(poses)


def _columns(rows: list[tuple[float, ...]]) -> tuple[str, ...]:
    load, scan, sonar, picture, factor = zip(*rows, strict=True)
    return (
        machine.spread([1e3 * each for each in load]),
        machine.spread([1e6 * each for each in scan]),
        machine.spread([1e6 * each for each in sonar]),
        machine.spread([1e3 * each for each in picture]),
        machine.spread(list(factor), 1),
    )
