"""Global localisation by eight sonars in the simulated flat and office, and after being carried.

A robot that does not know where it is wanders for 60 s: straight on, and round to the freer side
where its sonars see something near. Then it is carried to another place and wanders for 60 s more.
Sonars are those of `firmware_sim`, with noise, outliers and cross-talk, two groups of four fired in
turn; wheels roll by kinematics, with errors of scale that the odometry does not know.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks import machine
from firmware_sim.config.config import load_robot as load_simulated_robot
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.ranging.sonar_model import SonarModel
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

WORLDS = ("flat", "office")
SEEDS_A_ROUND = 20
SECONDS = 60.0
GROUP = 4
PERIOD_S = 0.025
NEAR_M, NEAR_RAD = 0.5, math.radians(20.0)
"""An estimate so near to the truth is right."""
SCALE, TRACK, ROLLING, TURNING = 0.01, 0.02, 0.01, 0.02
"""Standard deviations of what odometry has wrong: length and turn by scale; after 1 m, 1 rad."""
_CLEARANCE_M = 0.25
_SPEED_M_S, _TURN_RAD_S = 0.35, 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A world with what the localiser and the wanderer know of it."""

    name: str
    grid: GridMap
    clearance_m: NDArray[np.float64]
    model: SonarModel
    sonar_names: tuple[str, ...]

    @staticmethod
    def load(name: str) -> Room:
        """Read a world and the standard robot."""
        walls = WallMap(np.ascontiguousarray(load_world(find_file(name, "worlds")).segments))
        grid = grid_of_walls(walls)
        robot = load_robot(find_file("diff_drive"))
        clearance = ndimage.distance_transform_edt(grid.free()) * grid.resolution_m
        names = tuple(mount.name for mount in robot.sonar)
        return Room(name, grid, clearance, SonarModel(walls, robot.sonar), names)

    def is_clear(self, pose: SE2) -> bool:
        """Whether the robot can stand here."""
        row, column = self.grid.cell_of(np.array([[pose.x_m, pose.y_m]]))[0]
        return bool(self.clearance_m[row, column] > _CLEARANCE_M)


class Wanderer:
    """A robot that wanders in a room, its sonars and its odometry."""

    def __init__(self, room: Room, rng: np.random.Generator) -> None:
        self._room, self._rng = room, rng
        self._free = free_poses(room.grid)
        robot = load_simulated_robot(find_file("diff_drive"), {})
        self._ring = SonarRing(robot, load_world(find_file(room.name, "worlds")), rng)
        self._ranges = np.full(len(room.sonar_names), np.inf)
        self._scale, self._track = 1.0 + rng.normal(size=2) * (SCALE, TRACK)
        self._turning, self._group = 0.0, 0
        self.carry()

    def carry(self) -> None:
        """Put the robot down anywhere."""
        self.pose = SE2(*self._free(self._rng, 1)[0])
        while not self._room.is_clear(self.pose):
            self.pose = SE2(*self._free(self._rng, 1)[0])

    def step(self) -> tuple[SE2, int, NDArray[np.float64]]:
        """Move for a period; return odometry, the group that fired, and readings, nan if none."""
        distance, angle = self._command()
        moved = arc(self.pose, distance, angle)
        if self._room.is_clear(moved):
            self.pose = moved
        else:
            distance, angle = 0.0, math.copysign(_TURN_RAD_S * PERIOD_S, self._turning or 1.0)
            self.pose = arc(self.pose, 0.0, angle)
        noise = self._rng.normal(size=2) * (ROLLING, TURNING)
        odometry = arc(
            SE2(),
            distance * self._scale + noise[0] * math.sqrt(abs(distance)),
            angle * self._track + noise[1] * math.sqrt(abs(angle)),
        )
        self._group = (self._group + 1) % self._ring.groups
        ranges = np.full(len(self._ranges), np.nan)
        fired = slice(GROUP * self._group, GROUP * (self._group + 1))
        pose = self.pose
        ranges[fired] = self._ring.fire(self._group, pose.x_m, pose.y_m, pose.theta_rad)
        self._ranges[fired] = ranges[fired]
        return odometry, self._group, ranges

    def _command(self) -> tuple[float, float]:
        """Return distance and turn of the next period."""
        seen = dict(zip(self._room.sonar_names, self._ranges, strict=True))
        ahead = min(seen["front"], 1.4 * seen["front_left"], 1.4 * seen["front_right"])
        if self._turning == 0.0 and ahead < 0.5:
            left = seen["front_left"] + seen["left"] > seen["front_right"] + seen["right"]
            self._turning = 1.0 if left else -1.0
        elif self._turning != 0.0 and ahead > 0.9 and self._rng.random() < 0.1:
            self._turning = 0.0
        if self._turning != 0.0:
            return 0.0, self._turning * _TURN_RAD_S * PERIOD_S
        return _SPEED_M_S * PERIOD_S, 0.3 * self._rng.normal() * PERIOD_S


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a search of 60 s ended."""

    right: bool
    found_s: float
    """Since when the estimate was right until the end."""
    wrong_s: float
    """How long it claimed to be localised and was not."""
    busy_s: float
    """Processor time of the localiser."""


def search(wanderer: Wanderer, mcl: MonteCarloLocaliser, room: Room) -> Outcome:
    """Wander for a minute."""
    found_s, wrong_s, busy_s = math.inf, 0.0, 0.0
    right = False
    for i in range(round(SECONDS / PERIOD_S)):
        odometry, group, ranges = wanderer.step()
        began = time.process_time()
        mcl.move(odometry)
        if mcl.due(f"sonar {group}"):
            mcl.measure(room.model.measurement(ranges), f"sonar {group}")
        estimate = mcl.estimate(0)
        busy_s += time.process_time() - began
        near = is_near(estimate.pose, wanderer.pose)
        sure = estimate.status is LocalisationStatus.LOCALISED
        wrong_s += PERIOD_S * (sure and not near)
        if (near and sure) and not right:
            found_s = i * PERIOD_S
        right = near and sure
    return Outcome(right, found_s if right else math.inf, wrong_s, busy_s)


def is_near(estimate: SE2, truth: SE2) -> bool:
    """Whether an estimate is right."""
    off_m = math.hypot(estimate.x_m - truth.x_m, estimate.y_m - truth.y_m)
    return off_m < NEAR_M and abs(wrap_angle(estimate.theta_rad - truth.theta_rad)) < NEAR_RAD


def searches(room: Room, seed: int) -> Iterator[Outcome]:
    """Search from an unknown start, then after being carried."""
    wanderer_rng, mcl_rng = np.random.default_rng(seed).spawn(2)
    wanderer = Wanderer(room, wanderer_rng)
    mcl = MonteCarloLocaliser(MclConfig(), free_poses(room.grid), mcl_rng)
    yield search(wanderer, mcl, room)
    wanderer.carry()
    yield search(wanderer, mcl, room)


def run(rounds: int, _seconds: float) -> None:
    """Search with many seeds."""
    seeds = rounds * SEEDS_A_ROUND
    rows = []
    for name in WORLDS:
        room = Room.load(name)
        outcomes = [list(searches(room, seed)) for seed in range(seeds)]
        for i, what in enumerate(("unknown start", "carried away")):
            rows.append(_row(f"{name}, {what}", [each[i] for each in outcomes]))
    heads = (
        "world",
        "right at 60 s",
        "found after s (rounds)",
        "wrongly sure s",
        "CPU of a core %",
    )
    machine.table(f"Eight sonars and motion, {seeds} seeds, 60 s each (goal: 95 %)", heads, rows)


def _row(name: str, outcomes: list[Outcome]) -> tuple[str, ...]:
    found = [outcome.found_s for outcome in outcomes if outcome.right]
    return (
        name,
        f"{len(found)} of {len(outcomes)}",
        machine.spread(found, 1) if found else "never",
        f"{machine.median(outcome.wrong_s for outcome in outcomes):.1f}",
        f"{100 * machine.median(outcome.busy_s for outcome in outcomes) / SECONDS:.1f}",
    )
