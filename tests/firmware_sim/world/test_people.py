"""People and clutter: where they are, what sensors see of them, and who ran into whom."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.config.config import load_robot
from firmware_sim.errors import SimulationError
from firmware_sim.plant.discs import nearest_point
from firmware_sim.plant.plant import Plant
from firmware_sim.plant.walls import body_outline
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.simulation import Simulation
from firmware_sim.world.clutter import APART_M, CLEAR_M, cluttered
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.people import PARTED_M, STANDS_NS, TOUCH_M, People
from firmware_sim.world.walking.stubborn import Stubborn
from firmware_sim.world.walking.walker import RADIUS_M, STEP_NS
from firmware_sim.world.world import World, load_world
from tests.firmware_sim.plant.plants import command

CONFIGS = Path(__file__).parents[3] / "configs"
FLAT = load_world(CONFIGS / "worlds" / "flat.toml")
ROBOT = load_robot(CONFIGS / "diff_drive.toml")
HALL = World.from_segments(
    [(0, 0, 6, 0), (6, 0, 6, 6), (6, 6, 0, 6), (0, 6, 0, 0)], (3.0, 3.0, 0.0)
)


def distance_m(points: np.ndarray, world: World) -> float:
    """Return the smallest distance of points from all that stands, by a dense sample of it."""
    share = np.linspace(0.0, 1.0, 400)[:, None, None]
    sides = world.touchable
    samples = (sides[:, :2] + share * (sides[:, 2:] - sides[:, :2])).reshape(-1, 2)
    return min(float(np.hypot(*(samples - point).T).min()) for point in points)


def far_away(_place: np.ndarray, _radius_m: float) -> tuple[float, float]:
    return math.inf, 0.0


def test_clutter_stands_free_off_start_and_goal_and_is_on_no_map() -> None:
    goal = (6.0, 3.0)
    for seed in range(2):
        world = cluttered(FLAT, 5, seed, [goal])
        new = world.things[len(FLAT.things) :]
        assert len(new) == 5
        assert np.array_equal(world.segments, FLAT.segments)
        for number, thing in enumerate(new):
            others = dataclasses.replace(world, things=world.things[: len(FLAT.things) + number])
            assert distance_m(thing.corners, others) > 0.5 * APART_M
            assert not others.solid_at(*thing.corners.mean(axis=0))
            for place in (FLAT.start[:2], goal):
                assert np.hypot(*(thing.corners - place).T).min() > CLEAR_M - 1e-9
            assert thing.height_m > ROBOT.simulation.sonar.z_m
    with pytest.raises(SimulationError, match="pieces of clutter, 500 asked for"):
        cluttered(FLAT, 500, 1)


def test_one_seed_gives_one_clutter() -> None:
    one, same, other = (
        np.vstack([thing.corners for thing in cluttered(FLAT, 3, seed).things[-3:]])
        for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert one.shape != other.shape or not np.array_equal(one, other)


def test_people_walk_evenly_round_walls_and_go_on() -> None:
    people = People(FLAT, 3, np.random.default_rng(2))
    places = []
    for step in range(1, 3001):
        people.step(step * STEP_NS, far_away)
        places.append(people.discs[:, :2])
    walked = np.array(places)
    assert distance_m(walked[::20].reshape(-1, 2), FLAT) > RADIUS_M
    speeds = np.hypot(*np.moveaxis(np.diff(walked, axis=0), 2, 0)) / (STEP_NS * 1e-9)
    assert speeds.max() < 1.2 + 1e-9
    assert np.all(np.median(speeds, axis=0) > 0.5 - 1e-9)
    assert np.all(np.ptp(walked, axis=0).max(axis=1) > 1.0)
    assert people.hit == people.ran_into == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_way_is_free_and_little_longer_than_must_be(seed: int) -> None:
    space = FreeSpace(FLAT, 0.3, FLAT.start[:2])
    rng = np.random.default_rng(seed)
    begin, end = space.places[rng.integers(len(space.places), size=2)]
    way = space.way(begin, end)
    assert way[0] == pytest.approx(begin)
    assert way[-1] == pytest.approx(end)
    dense = [a + np.linspace(0, 1, 30)[:, None] * (b - a) for a, b in itertools.pairwise(way)]
    assert distance_m(np.vstack(dense), FLAT) > 0.2
    back = space.way(end, begin)
    lengths = [np.hypot(*np.diff(each, axis=0).T).sum() for each in (way, back)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.05)


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_the_distance_from_the_outline_is_that_of_a_dense_sample(x: float, y: float) -> None:
    outline = body_outline(ROBOT.bodies[0])
    distance, near_x, near_y = nearest_point(x, y, outline)
    after = np.roll(outline[:, :2], -1, axis=0)
    share = np.linspace(0.0, 1.0, 500)[:, None, None]
    samples = (outline[:, :2] + share * (after - outline[:, :2])).reshape(-1, 2)
    assert abs(distance) == pytest.approx(np.hypot(*(samples - (x, y)).T).min(), abs=1e-3)
    assert math.dist((x, y), (near_x, near_y)) == pytest.approx(abs(distance), abs=1e-12)
    inside = all((x - vx) * nx + (y - vy) * ny <= 0.0 for vx, vy, nx, ny in outline[:, :4])
    assert (distance < 0.0) == (inside and distance != 0.0)


def test_a_robot_that_drives_against_a_disc_stops_there_and_that_is_no_wall() -> None:
    plant = Plant(ROBOT, HALL, np.random.default_rng(1))
    plant.discs = np.array([[4.0, 3.05, RADIUS_M]])
    command(plant, 0.3, 0.3)
    nose_m = max(x for x, _ in ROBOT.simulation.body)
    for _ in range(400):
        plant.step(10)
        gap_m, _ = plant.contact(plant.discs[0, :2], RADIUS_M, plant.motion)
        assert gap_m > -1e-3
        if plant.x_m > 4.0 - nose_m - RADIUS_M - 0.1:
            break
    plant.step(300)
    gap_m, _ = plant.contact(plant.discs[0, :2], RADIUS_M, plant.motion)
    assert -1e-3 < gap_m < TOUCH_M
    assert plant.collisions == 0


def walker(*corners: list[float], speed_m_s: float = 1.0) -> People:
    """Return one person in the hall who walks to and fro."""
    people = People(HALL, 1, np.random.default_rng(0))
    people._people[:] = [Stubborn(np.array([*corners, corners[0]]), speed_m_s)]
    return people


def met(robot_m_s: float, person_m_s: float) -> tuple[int, int]:
    """Return who ran into whom when robot and person move towards each other, or apart."""
    people = walker([5.0, 3.0], [1.0, 3.0], speed_m_s=person_m_s)
    nose_m = [3.0]

    def contact(place: np.ndarray, radius_m: float) -> tuple[float, float]:
        return float(place[0]) - radius_m - nose_m[0], robot_m_s

    for step in range(1, 300):
        nose_m[0] += robot_m_s * STEP_NS * 1e-9
        people.step(step * STEP_NS, contact)
        if people.hit or people.ran_into:
            break
    return people.hit, people.ran_into


def test_who_moves_towards_the_other_is_to_blame_the_robot_from_a_creep_on() -> None:
    assert met(0.0, 1.0) == (0, 1)
    assert met(0.04, 1.0) == (0, 1)
    assert met(-0.3, 1.0) == (0, 1)
    assert met(0.06, 1.0) == (1, 0)
    assert met(1.0, 0.5) == (1, 0)


def test_who_met_the_robot_stands_and_then_leaves_and_one_contact_counts_once() -> None:
    people = walker([3.0 + 0.3 + RADIUS_M + 0.1, 3.0], [1.0, 3.0])

    def contact(place: np.ndarray, radius_m: float) -> tuple[float, float]:
        return math.dist(place, (3.0, 3.0)) - 0.3 - radius_m, 0.0

    gaps = []
    for step in range(1, 1001):
        people.step(step * STEP_NS, contact)
        gaps.append(contact(people.discs[0, :2], RADIUS_M)[0])
    assert min(gaps) > 0.0
    first = next(n for n, gap in enumerate(gaps) if gap <= 0.02)
    stands = STANDS_NS // STEP_NS
    assert np.ptp(gaps[first + 5 : first + stands - 5]) == 0.0
    assert max(gaps) > PARTED_M
    assert people.hit == 0
    assert 1 <= people.ran_into <= 5


def test_sonar_and_lidar_see_people_and_without_them_nothing_changes() -> None:
    lidar = Lidar(
        dataclasses.replace(ROBOT.simulation.lidars[0], sigma_m=0.0, dropout_probability=0.0),
        HALL,
        np.random.default_rng(1),
    )
    before = lidar.scan(1.0, 3.0, 0.0)
    people = walker([3.0, 3.0], [1.0, 3.0])
    lidar.walls.moving = people.sides
    after = lidar.scan(1.0, 3.0, 0.0)
    nearer = after < before
    mount_m = lidar.parameters.x_m
    assert after[nearer].min() == pytest.approx(2.0 - mount_m - RADIUS_M, abs=0.01)
    seen_rad = np.abs(lidar.angles_rad[nearer]).max()
    assert seen_rad == pytest.approx(math.asin(RADIUS_M / (2.0 - mount_m)), abs=0.02)
    lidar.walls.moving = people.sides[:0]
    assert np.array_equal(lidar.scan(1.0, 3.0, 0.0), before)


def test_a_run_with_people_repeats_and_they_meet_the_robot_that_stands() -> None:
    small = World.from_segments(
        [(0, 0, 3, 0), (3, 0, 3, 3), (3, 3, 0, 3), (0, 3, 0, 0)], (1.5, 1.5, 0.0)
    )
    truths = []
    for _ in range(2):
        simulation = Simulation(ROBOT, small, 5, people=2)
        for step in range(1, 400):
            simulation.advance(step * 73_000_000)
        truths.append(simulation.truth())
    assert truths[0] == truths[1]
    assert truths[0].ran_into > 0
    assert truths[0].collisions == 0
    assert truths[0].distance_m < 0.05


PATH = """
[[person]]
points = [[3.0, 1.0], [3.0, 3.0]]
speed_m_s = 0.5
"""


def test_who_is_in_a_worlds_file_walks_to_and_fro_on_their_way(tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    file.write_text((CONFIGS / "worlds" / "flat.toml").read_text() + PATH)
    world = load_world(file)
    people = People(world, 0, np.random.default_rng(1))
    for k in range(1, 1200):
        people.step(k * STEP_NS, far_away)
        done_m = 0.5 * k * STEP_NS * 1e-9
        ((x_m, y_m),) = people.places_m
        assert (x_m, y_m) == pytest.approx((3.0, 1.0 + 2.0 - abs(done_m % 4.0 - 2.0)))
    assert len(People(world, 2, np.random.default_rng(1)).places_m) == 3


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("points = [[3.0, 1.0]]", "person.0.points: "),
        ("points = [[3.0, 1.0], [3.0, 1.0]]", "two that follow each other coincide"),
        ("points = [[3.0, 1.0], [3.0, 3.0]]\nspeed_m_s = 0.0", "person.0.speed_m_s: "),
    ],
)
def test_people_who_cannot_walk_are_refused(wrong: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    file.write_text((CONFIGS / "worlds" / "flat.toml").read_text() + f"[[person]]\n{wrong}\n")
    with pytest.raises(SimulationError, match=said):
        load_world(file)
