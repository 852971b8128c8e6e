"""Recognising places by eight sonars: five places of a world, and places that nobody has learnt.

A robot is put down near a place, turned by any angle, and turns on the spot once; its signature is
compared with those that were learnt, two visits of each place. Sonars are those of `firmware_sim`,
with noise, outliers and cross-talk, two groups of four fired in turn; while it turns the robot
drifts, and its odometry has the turn wrong by scale and by noise. In the first row the whole
simulated robot turns, in lockstep, at the marks of the office.

Then a recognition is the only measurement of a particle filter that starts anywhere; visits are
made farther away from the places; and sonars break after the places were learnt.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks import machine
from firmware_sim.config.config import load_robot as load_simulated_robot
from firmware_sim.sensors.sonar import GROUP, SonarRing
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.fix import place_fix
from robotctl.estimation.places.signature_turn import Turn, TurnCollector
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarReading
from robotctl.model.wall_map import WallMap
from robotctl.workbench.places.places import marked
from robotctl.workbench.places.sim import simulated_turn

WORLDS = ("office", "flat", "corridor_loop", "hall")
MARKS = ("south_room", "meeting_room", "kitchen", "lounge", "open_area")
PLACES, VISITS, LEARNT = 5, 20, 2
SPOT_M = 0.05
"""So far from a place its visits are."""
APART_M = 1.0
"""Unknown places are farther than this from all known ones, and these from each other."""
SCALE, TURNING, DRIFT_M = 0.01, 0.02, 0.02
"""Odometry: error of a turn by scale, and after 1 rad [rad]; the robot's drift in a turn [m]."""
AWAY_M = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
BROKEN = {
    "one missing": {2: math.nan},
    "one deaf": {2: math.inf},
    "one stuck at 1 m": {2: 1.0},
    "two deaf": {2: math.inf, 5: math.inf},
    "four missing": dict.fromkeys((0, 2, 5, 7), math.nan),
}
"""What broken sonars say, by their index."""
FEW = 4
"""Visits to a place from each distance, and with each broken sonar."""
_CLEARANCE_M = 0.35
_TURN_RAD_S, _PERIOD_S = 0.6, 0.025
_CONFIG = SignatureConfig()

Turned: TypeAlias = Callable[[SE2], tuple[Turn, SE2]]
"""From where the robot is put down to its turn, and where it stands at its end."""


class Room:
    """A world in which a robot can be put down and turned.

    Parameters
    ----------
    name
        Of the world.
    rng
        Of all chance.
    """

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self._world = find_file(name, "worlds")
        world = load_world(self._world)
        self._path = find_file("diff_drive")
        self._robot = load_robot(self._path)
        self._rng = rng
        self._ring = SonarRing(load_simulated_robot(self._path, {}), world, rng)
        grid = grid_of_walls(WallMap(np.ascontiguousarray(world.segments)))
        self._grid, self.sample_free = grid, free_poses(grid)
        self.area_m2 = float(np.count_nonzero(grid.free())) * grid.resolution_m**2
        self.broken: dict[int, float] = {}
        self._clearance = ndimage.distance_transform_edt(grid.free()) * grid.resolution_m

    def clear_pose(self, away: Sequence[SE2] = ()) -> SE2:
        """Return a random pose at which the robot can turn, and that is away from others."""
        while True:
            pose = SE2(*self.sample_free(self._rng, 1)[0].tolist())
            row, column = self._grid.cell_of(np.array([[pose.x_m, pose.y_m]]))[0]
            if self._clearance[row, column] > _CLEARANCE_M and all(
                math.hypot(pose.x_m - each.x_m, pose.y_m - each.y_m) > APART_M for each in away
            ):
                return pose

    def near(self, place: SE2, away_m: float | None = None) -> SE2:
        """Return a pose near a place, or so far away, with any heading."""
        away_m = SPOT_M * math.sqrt(self._rng.random()) if away_m is None else away_m
        angle, theta = self._rng.uniform(-math.pi, math.pi, 2).tolist()
        return SE2(
            place.x_m + away_m * math.cos(angle), place.y_m + away_m * math.sin(angle), theta
        )

    def turned(self, start: SE2) -> tuple[Turn, SE2]:
        """Turn on the spot by kinematics."""
        collector = TurnCollector(self._robot.sonar, _CONFIG)
        scale = 1.0 + SCALE * self._rng.standard_normal()
        drift = DRIFT_M * _TURN_RAD_S * _PERIOD_S / math.tau * self._rng.standard_normal(2)
        step = _TURN_RAD_S * _PERIOD_S * self._rng.choice((-1.0, 1.0))
        pose, odometry, i = start, SE2(), 0
        while True:
            group = i % self._ring.groups
            ranges = np.full(len(self._robot.sonar), np.nan)
            ranges[GROUP * group : GROUP * (group + 1)] = self._ring.fire(
                group, pose.x_m, pose.y_m, pose.theta_rad
            )
            for k, says in self.broken.items():
                ranges[k] = np.nan if np.isnan(ranges[k]) else says
            turn = collector.add(SonarReading(i, tuple(ranges.tolist())), odometry)
            if turn is not None:
                return turn, pose
            noise = TURNING * math.sqrt(abs(step)) * self._rng.standard_normal()
            pose = arc(SE2(pose.x_m + drift[0], pose.y_m + drift[1], pose.theta_rad), 0.0, step)
            odometry = arc(odometry, 0.0, scale * step + noise)
            i += 1

    def turned_in_lockstep(self, start: SE2) -> tuple[Turn, SE2]:
        """Let the whole simulated robot turn on the spot."""
        seed = int(self._rng.integers(1 << 30))
        visited = simulated_turn(
            self._path, self._robot, (), self._world, start, seed, _CONFIG, lambda _turned: None
        )
        return visited.turn, visited.pose or SE2()

    def telling_places(self) -> list[SE2]:
        """Return places where there are echoes enough to learn them."""
        places: list[SE2] = []
        while len(places) < PLACES:
            pose = self.clear_pose(places)
            if not PlaceBook().too_little(self.turned(pose)[0].signature):
                places.append(pose)
        return places


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What came of one seed, or of several.

    Attributes
    ----------
    confusion
        Rows: the places, then the unknown ones; columns: what was recognised, then refused.
    turned_rad
        Error of the rotation and its stated deviation, of those that were right.
    position_nees
        Squared error of the position by its covariance, two dimensions, of those.
    ruled_out
        Share of the known visits that a recognition does not compare in full.
    busy_us
        Processor time of a recognition.
    """

    confusion: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros((PLACES + 1, PLACES + 1), np.int64)
    )
    turned_rad: list[tuple[float, float]] = field(default_factory=list)
    position_nees: list[float] = field(default_factory=list)
    ruled_out: list[float] = field(default_factory=list)
    busy_us: list[float] = field(default_factory=list)

    @property
    def right(self) -> float:
        """Share of the visits to known places that were recognised as what they are."""
        return float(np.trace(self.confusion[:-1]) / self.confusion[:-1].sum())

    @property
    def mistaken(self) -> float:
        """Share of the visits to known places that were taken for another one."""
        known = self.confusion[:-1, :-1]
        return float((known.sum() - np.trace(known)) / self.confusion[:-1].sum())

    @property
    def refused(self) -> float:
        """Share of the visits to unknown places that were refused."""
        return float(self.confusion[-1, -1] / self.confusion[-1].sum())

    def visit(self, book: PlaceBook, turn: Turn, end: SE2, i: int) -> None:
        """Recognise a turn at place `i`."""
        began = time.process_time()
        recognition = book.suggest(turn.signature)
        self.busy_us.append(1e6 * (time.process_time() - began))
        found = recognition.found
        self.confusion[i, PLACES if found is None else int(found.place)] += 1
        if found is not None and int(found.place) == i:
            sigma_rad = math.sqrt(recognition.rotation_variance)
            self.turned_rad.append((wrap_angle(found.pose.theta_rad - end.theta_rad), sigma_rad))
            off = np.array([found.pose.x_m - end.x_m, found.pose.y_m - end.y_m])
            squared = off @ np.linalg.solve(found.covariance[:2, :2], off)
            self.position_nees.append(float(squared))


def learnt(room: Room, places: Sequence[SE2], turned: Turned) -> PlaceBook:
    """Return a book of places."""
    book = PlaceBook(signatures=_CONFIG)
    for i, place in enumerate(places):
        for _ in range(LEARNT):
            turn, end = turned(room.near(place))
            book = book.learned(str(i), turn.signature, end)
    return book


def trial(room: Room, places: Sequence[SE2], turned: Turned, outcome: Outcome) -> PlaceBook:
    """Learn places, visit them again, and visit as many others; return the book."""
    book = learnt(room, places, turned)
    starts = [(i, room.near(place)) for i, place in enumerate(places) for _ in range(VISITS)]
    starts += [(PLACES, room.clear_pose(places)) for _ in range(PLACES * VISITS)]
    for i, start in starts:
        turn, end = turned(start)
        outcome.visit(book, turn, end, i)
        compared = book.worth_comparing(book.compare(turn.signature))
        outcome.ruled_out.append(1.0 - len(compared) / (PLACES * LEARNT))
    return book


def located(room: Room, places: Sequence[SE2], book: PlaceBook, seed: int) -> list[float]:
    """Return how far from the truth a filter is that only one recognition tells its place [m]."""
    found = []
    for place in places:
        turn, end = room.turned(room.near(place))
        mcl = MonteCarloLocaliser(MclConfig(), room.sample_free, np.random.default_rng(seed))
        fix = place_fix(book.suggest(turn.signature), room.area_m2)
        if fix is not None:
            mcl.measure(fix, "places")
        pose = mcl.estimate(0).pose
        found.append(math.hypot(pose.x_m - end.x_m, pose.y_m - end.y_m))
    return found


def harder(rounds: int) -> None:
    """Visit the places of the office from farther away, and with broken sonars."""
    away = {away_m: Outcome() for away_m in AWAY_M}
    broken = {name: Outcome() for name in BROKEN}
    for seed in range(rounds):
        room = Room("office", np.random.default_rng(100 + seed))
        places = room.telling_places()
        book = learnt(room, places, room.turned)
        for i, place in FEW * list(enumerate(places)):
            for away_m, outcome in away.items():
                outcome.visit(book, *room.turned(room.near(place, away_m)), i)
            for name, outcome in broken.items():
                room.broken = BROKEN[name]
                outcome.visit(book, *room.turned(room.near(place)), i)
                outcome.visit(book, *room.turned(room.clear_pose(places)), PLACES)
                room.broken = {}
    rows = [
        (f"{away_m} m away", f"{100 * each.right:.0f}", f"{100 * each.mistaken:.0f}", "")
        for away_m, each in away.items()
    ]
    rows += [
        (
            f"sonars: {name}",
            f"{100 * each.right:.0f}",
            f"{100 * each.mistaken:.0f}",
            f"{100 * each.refused:.0f}",
        )
        for name, each in broken.items()
    ]
    heads = ("office", "right %", "taken for another place %", "unknown refused %")
    machine.table(f"Harder, {rounds} seeds, {FEW * PLACES} visits each", heads, rows)


def run(rounds: int, _seconds: float) -> None:
    """Try the marks of the office in lockstep, then many seeds in each world."""
    outcomes: dict[str, Outcome] = {}
    room = Room("office", np.random.default_rng(0))
    marks = [marked(find_file("office", "worlds"), name) for name in MARKS]
    outcomes["office, marks, lockstep"] = Outcome()
    trial(room, marks, room.turned_in_lockstep, outcomes["office, marks, lockstep"])
    off_m: dict[str, list[float]] = {name: [] for name in WORLDS}
    for name in WORLDS:
        outcomes[name] = Outcome()
        for seed in range(rounds):
            room = Room(name, np.random.default_rng(seed))
            places = room.telling_places()
            book = trial(room, places, room.turned, outcomes[name])
            off_m[name] += located(room, places, book, seed)
    heads = (
        "world", "visits", "right %", "unknown refused %", "turned wrong by deg p50, p95",
        "within stated 2 sigma %", "position NEES (2)", "ruled out %", "us",
    )  # fmt: skip
    rows = [_row(name, outcome) for name, outcome in outcomes.items()]
    machine.table(
        f"{PLACES} places x {VISITS} visits, {rounds} seeds (goal: 95, 95 %)", heads, rows
    )
    heads = ("world", "starts", "within 0.5 m of the truth", "off m p50")
    rows = [
        (name, str(len(off)), f"{np.count_nonzero(np.array(off) < 0.5)}", f"{np.median(off):.2f}")
        for name, off in off_m.items()
    ]
    machine.table("Particles anywhere, after one recognition", heads, rows)
    harder(rounds)
    for name, outcome in outcomes.items():
        columns = ("", *(f"place {i + 1}" for i in range(PLACES)), "refused")
        names = (*columns[1:-1], "unknown")
        counts = [
            (row, *map(str, line))
            for row, line in zip(names, outcome.confusion.tolist(), strict=True)
        ]
        machine.table(f"Confusion in {name}", columns, counts)


def _row(name: str, outcome: Outcome) -> tuple[str, ...]:
    """Return the figures of a world."""
    off, sigma = np.abs(np.array(outcome.turned_rad)).T
    middle, most = np.degrees(np.percentile(off, (50, 95)))
    return (
        name,
        str(outcome.confusion.sum()),
        f"{100 * outcome.right:.1f}",
        f"{100 * outcome.refused:.1f}",
        f"{middle:.1f}, {most:.1f}",
        f"{100 * np.mean(off < 2.0 * sigma):.0f}",
        f"{np.mean(outcome.position_nees):.2f}",
        f"{100 * np.mean(outcome.ruled_out):.0f}",
        f"{machine.median(outcome.busy_us):.0f}",
    )
