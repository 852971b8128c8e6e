"""The simulated camera: processor time of a picture, and what it costs the simulator's loop.

The loop keeps events of 1 kHz at their times while the camera's process draws 15 pictures a second
and another process takes them.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import machine
from firmware_sim.camera.camera import Camera
from firmware_sim.camera.process import CameraProcess
from firmware_sim.config.config import load_robot
from firmware_sim.errors import SimulationError
from firmware_sim.plant.plant import Plant
from firmware_sim.realtime import RealTime
from firmware_sim.simulation import Simulation
from firmware_sim.world.world import World, load_world
from robotctl.config.robot_file import find_file
from robotctl.drivers.camera.simulated_camera import SimulatedCamera

WORLDS = ("empty_room", "office", "clutter")
GOAL_MS = 15.0
POSES = 20
LAGS_HZ = 1000
RATE_HZ = 15.0
PRIORITY = 60


def run(rounds: int, seconds: float) -> None:
    """Measure pictures of 640 x 480 at seeded poses, then the loop with and without the camera."""
    robot = find_file("diff_drive")
    heads = ("world", "ms of a picture (rounds)", "slowest pose ms", "sectors us", "start s")
    rows = [_row(robot, name, rounds) for name in WORLDS]
    machine.table(f"Simulated camera, 640 x 480, one core: goal {GOAL_MS:g} ms", heads, rows)
    lags: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for _ in range(rounds):
        for camera, each in lags.items():
            # A new process each time, since only the loop's own may keep its priority.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
                each.append(process.submit(_lags, robot, camera, seconds).result())
    heads = ("camera", "p50 us", "p99 us", "p99.9 us (rounds)", "greatest us (rounds)")
    table = [
        (
            f"{RATE_HZ:g} Hz" if camera else "off",
            *(f"{machine.median(np.percentile(lag, q) for lag in each):.0f}" for q in (50, 99)),
            machine.spread([float(np.percentile(lag, 99.9)) for lag in each]),
            machine.spread([float(lag.max()) for lag in each]),
        )
        for camera, each in lags.items()
    ]
    title = f"Lag of {LAGS_HZ} events a second in the simulator's loop, priority {PRIORITY}"
    machine.table(title, heads, table)


def _row(robot: Path, name: str, rounds: int) -> tuple[str, ...]:
    """Processor time in one world."""
    world = load_world(find_file(name, "worlds"))
    poses = _poses(robot, world)
    begin_s = time.process_time()
    camera = Camera(load_robot(robot), world)
    start_s = time.process_time() - begin_s
    camera.look(*poses[0])
    times = np.array(
        [[_time_ms(partial(camera.look, *pose)) for pose in poses] for _ in range(rounds)]
    )
    sectors = [_time_ms(partial(camera.turn, *pose)) for pose in poses for _ in range(rounds)]
    return (
        name,
        machine.spread([float(np.median(each)) for each in times], 1),
        f"{np.median(times, axis=0).max():.1f}",
        f"{1e3 * machine.median(sectors):.0f}",
        f"{start_s:.1f}",
    )


def _time_ms(action: partial[object]) -> float:
    begin_s = time.process_time()
    action()
    return (time.process_time() - begin_s) * 1e3


def _poses(robot: Path, world: World) -> list[tuple[float, float, float]]:
    """Return poses at which the robot can stand, the same each time."""
    rng = np.random.default_rng(1)
    plant = Plant(load_robot(robot), world, rng)
    low_x, low_y, high_x, high_y = world.bounds
    poses: list[tuple[float, float, float]] = []
    while len(poses) < POSES:
        pose = rng.uniform((low_x, low_y, -math.pi), (high_x, high_y, math.pi))
        try:
            plant.place(*pose)
        except SimulationError:
            continue
        poses.append((float(pose[0]), float(pose[1]), float(pose[2])))
    return poses


def _lags(robot: Path, camera: bool, seconds: float) -> np.ndarray:
    """Lags of the events of one round [us]."""
    world = find_file("office", "worlds")
    settings = {"camera.rate_hz": RATE_HZ}
    simulation = Simulation(load_robot(robot, settings), world)
    simulation.warm()
    loop = RealTime(simulation)
    lags: list[int] = []
    period_ns = 1_000_000_000 // LAGS_HZ
    bus = simulation.bus

    def event() -> None:
        lags.append(time.monotonic_ns() - loop.origin_ns - bus.now_ns)
        bus.schedule(bus.now_ns + period_ns, event)

    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        if camera:
            address = f"ipc://{folder}/sockets/camera"
            arguments = [f"--robot={robot}", f"--world={world}", f"--camera={address}"]
            arguments += [f"--set={key}={value}" for key, value in settings.items()]
            loop.take_pictures(stack.enter_context(CameraProcess(arguments)))
            taker = multiprocessing.get_context("spawn").Process(target=_take, args=(address,))
            taker.start()
            stack.callback(taker.join)
            stack.callback(taker.terminate)
        bus.schedule(bus.now_ns + period_ns, event)
        end_ns = simulation.now_ns + round(seconds * 1e9)
        loop.run(lambda: simulation.now_ns >= end_ns, PRIORITY)
    return np.array(lags[LAGS_HZ // 2 :]) / 1e3


def _take(address: str) -> None:
    """Take pictures as a robot would, until ended."""
    os.nice(5)
    camera = SimulatedCamera(address)
    while True:
        camera.read()
        time.sleep(0.005)
