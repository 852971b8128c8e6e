"""Manners of people: who evades whom, where they may be, how fast they are."""

from __future__ import annotations

import argparse
import itertools
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from firmware_sim.errors import SimulationError
from firmware_sim.plant.body_disc import BodyDisc
from firmware_sim.world.manner import Manner, deal, parse_manners
from firmware_sim.world.people import PARTED_M, People
from firmware_sim.world.shapes import Person
from firmware_sim.world.walking.evading import Evading
from firmware_sim.world.walking.orca import HalfPlane, choose, off_mover
from firmware_sim.world.walking.stubborn import Stubborn
from firmware_sim.world.walking.walker import RADIUS_M, STEP_NS, STEP_S, Mover, Walker
from firmware_sim.world.walking.walkers import WALKERS
from firmware_sim.world.world import World, load_world
from tests.firmware_sim.world.test_people import distance_m, far_away

FLAT = load_world(Path(__file__).parents[3] / "configs" / "worlds" / "flat.toml")
OPEN = World.from_segments([(-9, -9, 9, -9), (9, -9, 9, 9), (9, 9, -9, 9), (-9, 9, -9, -9)])
NO_WALLS = np.empty((0, 4))


def walked(people: People, seconds: float) -> np.ndarray:
    """Return the places of all people after each step, (steps, n, 2) [m]."""
    places = []
    for step in range(1, round(seconds / STEP_S) + 1):
        people.step(step * STEP_NS, far_away)
        places.append(people.places_m)
    return np.array(places)


def crowd(*walkers: Walker) -> People:
    """Return these people in the open."""
    people = People(OPEN, 0, np.random.default_rng(0))
    people._people[:] = walkers
    people._seen = people.places_m
    return people


def evading(begin: tuple[float, float], end: tuple[float, float], speed: float = 1.0) -> Evading:
    """Return who walks to and fro between two places in the open."""
    return Evading(np.array([begin, end, begin]), speed, NO_WALLS)


def gaps_m(places: np.ndarray) -> np.ndarray:
    """Return the smallest gap between any two people after each step [m]."""
    pairs = itertools.combinations(range(places.shape[1]), 2)
    apart = [np.hypot(*(places[:, a] - places[:, b]).T) for a, b in pairs]
    return np.min(apart, axis=0) - 2.0 * RADIUS_M


@given(st.floats(0.4, 1.5), st.floats(0.4, 1.5), st.floats(-0.3, 0.3))
@settings(max_examples=25)
def test_two_who_evade_and_meet_head_on_never_overlap_and_pass(
    speed_a: float, speed_b: float, aside_m: float
) -> None:
    one = evading((-4.0, 0.0), (4.0, 0.0), speed_a)
    other = evading((4.0, aside_m), (-4.0, aside_m), speed_b)
    places = walked(crowd(one, other), 5.0 + 8.0 / (speed_a + speed_b))
    assert gaps_m(places).min() > 0.0
    assert np.any(places[:, 0, 0] > places[:, 1, 0])


@pytest.mark.parametrize("count", [3, 5])
def test_those_who_evade_cross_a_circle_without_a_contact(count: int) -> None:
    angles = np.arange(count) * 2.0 * math.pi / count
    ends = [(4.0 * math.cos(a), 4.0 * math.sin(a)) for a in angles]
    walkers = [evading(each, (-each[0], -each[1])) for each in ends]
    places = walked(crowd(*walkers), 20.0)
    assert gaps_m(places).min() > 0.0
    middle_m = np.sum(places * np.array(ends)[None], axis=2) / 4.0
    assert np.all(middle_m.min(axis=0) < -3.0)  # each was on its other side


@pytest.mark.parametrize("aside_m", [0.0, 0.15, -0.3])
def test_who_evades_makes_way_alone_for_the_stubborn(aside_m: float) -> None:
    stubborn = Stubborn(np.array([[4.0, aside_m], [-9.0, aside_m], [4.0, aside_m]]), 1.0)
    places = walked(crowd(evading((-4.0, 0.0), (4.0, 0.0)), stubborn), 7.0)
    assert gaps_m(places).min() > 0.0
    assert np.allclose(places[:, 1, 1], aside_m)
    assert places[-1, 0, 0] > 2.0


def test_who_evades_walks_round_a_robot_that_stands_and_touches_it_not() -> None:
    half_m = (0.3, 0.2)
    body = [(sx * half_m[0], sy * half_m[1]) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    robot = BodyDisc.around(body).moving((0.0, 0.0, 0.3), (0.0, 0.0, 0.0))
    c, s = math.cos(0.3), math.sin(0.3)

    def contact(place: tuple[float, float], radius_m: float) -> tuple[float, float]:
        x, y = c * place[0] + s * place[1], -s * place[0] + c * place[1]
        outside = max(abs(x) - half_m[0], 0.0), max(abs(y) - half_m[1], 0.0)
        return math.hypot(*outside) - radius_m, 0.0

    people, gaps = crowd(evading((-4.0, 0.0), (4.0, 0.0))), []
    for step in range(1, 1001):
        people.step(step * STEP_NS, contact, lambda: robot)
        gaps.append(contact(people.places_m[0], RADIUS_M)[0])
        if people.places_m[0][0] > 3.0:
            break
    assert people.places_m[0][0] > 3.0
    assert min(gaps) > 0.5 * PARTED_M
    assert people.hit == people.ran_into == 0


@pytest.mark.parametrize("seed", range(3))
def test_those_who_evade_touch_no_wall_and_get_on(seed: int) -> None:
    people = People(FLAT, 5, np.random.default_rng(seed), (Manner.EVADES,))
    places = walked(people, 60.0)
    assert distance_m(places[::10].reshape(-1, 2), FLAT) > RADIUS_M - 1e-3
    way_m = np.hypot(*np.moveaxis(np.diff(places, axis=0), 2, 0)).sum(axis=0)
    assert np.all(way_m > 10.0)
    gaps = gaps_m(places)
    parted = int(np.argmax(gaps > 0.0))  # they may begin in one place
    assert parted < 200
    assert gaps[parted:].min() > -0.02


def test_who_evades_turns_back_where_the_way_is_closed() -> None:
    wall = np.array([[1.0, -3.0, 1.0, 3.0]])
    walker = Evading(np.array([[-2.0, 0.0], [4.0, 0.0], [-2.0, 0.0]]), 0.8, wall)
    places = walked(crowd(walker), 15.0)[:, 0]
    assert places[:, 0].max() < 1.0 - RADIUS_M + 1e-6
    reached = int(np.argmax(places[:, 0] > 0.7))
    assert reached > 0
    assert places[reached:, 0].min() < -1.0


@given(
    st.lists(st.tuples(st.floats(-math.pi, math.pi), st.floats(-1.5, 1.0)), max_size=6),
    st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
)
def test_the_chosen_velocity_is_the_nearest_of_a_dense_sample(
    planes: list[tuple[float, float]], wish: tuple[float, float]
) -> None:
    rims = [HalfPlane(math.cos(a), math.sin(a), least) for a, least in planes]
    axis = np.linspace(-1.5, 1.5, 151)
    sample = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    sample = sample[np.hypot(*sample.T) <= 1.5]
    lacks = np.array([r.least_m_s - sample @ (r.nx, r.ny) for r in rims])
    worst = lacks.max(axis=0) if rims else np.full(len(sample), -1.0)
    vx, vy = choose(wish, 1.5, [], rims)
    assert math.hypot(vx, vy) < 1.5 + 1e-6
    lack = max((each.lacks_m_s((vx, vy)) for each in rims), default=-1.0)
    assert lack <= max(float(worst.min()), 0.0) + 1e-3
    allowed = sample[worst <= 0.0]
    if len(allowed) and lack <= 1e-6:
        nearest = np.hypot(*(allowed - wish).T).min()
        assert math.dist((vx, vy), wish) <= nearest + 1e-6


@given(
    st.floats(0.5, 4.0),
    st.floats(-math.pi, math.pi),
    st.tuples(*[st.floats(-1.5, 1.5)] * 4),
    st.tuples(*[st.floats(-1.5, 1.5)] * 4),
)
@settings(max_examples=300)
def test_velocities_within_both_half_planes_keep_two_apart_for_the_horizon(
    apart_m: float, angle_rad: float, now: tuple[float, ...], then: tuple[float, ...]
) -> None:
    one = Mover(0.0, 0.0, *now[:2], RADIUS_M)
    place = apart_m * math.cos(angle_rad), apart_m * math.sin(angle_rad)
    other = Mover(*place, *now[2:], RADIUS_M)
    mine, yours = (
        choose(wish, 3.0, [], [off_mover(a, b, 0.5, 2.0, 0.1)])
        for a, b, wish in ((one, other, then[:2]), (other, one, then[2:]))
    )
    times = np.linspace(0.0, 2.0, 401)[:, None]
    apart = np.array(place) + times * (np.array(yours) - np.array(mine))
    assert np.hypot(*apart.T).min() > 2.0 * RADIUS_M - 1e-6


@pytest.mark.parametrize("manner", [Manner.WANDERS, Manner.RUNS])
@pytest.mark.parametrize("seed", range(3))
def test_who_roams_stays_in_the_free_space_and_stops_and_turns(manner: Manner, seed: int) -> None:
    places = walked(People(FLAT, 2, np.random.default_rng(seed), (manner,)), 60.0)
    assert distance_m(places[::10].reshape(-1, 2), FLAT) > RADIUS_M
    steps = np.diff(places, axis=0)
    speeds = np.hypot(steps[..., 0], steps[..., 1]) / STEP_S
    stands = (speeds < 1e-9).mean(axis=0)
    assert np.all((stands > 0.05) & (stands < 0.9))
    assert np.all(np.ptp(places, axis=0).max(axis=1) > 1.0)
    going = speeds[speeds > 1e-9]
    if manner is Manner.RUNS:
        assert going.min() > 1.5 - 1e-6
        assert 2.2 < going.max() < 2.5 + 1e-6
    else:
        assert going.max() < 1.2 + 1e-6
        assert np.ptp(going) > 0.2


@pytest.mark.parametrize("manner", list(Manner))
def test_one_seed_gives_one_walk(manner: Manner) -> None:
    one, same, other = (
        walked(People(FLAT, 2, np.random.default_rng(seed), (manner,)), 5.0) for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_manners_do_not_change_where_people_begin() -> None:
    begins = [
        People(FLAT, 4, np.random.default_rng(3), manners).places_m
        for manners in ((Manner.STUBBORN,), (Manner.RUNS,), tuple(Manner))
    ]
    assert begins[0] == begins[1] == begins[2]


def test_every_manner_has_a_walker_and_mixed_are_all_of_them_equally_often() -> None:
    assert set(WALKERS) == set(Manner)
    assert parse_manners("mixed") == tuple(Manner)
    assert parse_manners("runs,evades") == (Manner.RUNS, Manner.EVADES)
    firsts = set()
    for seed in range(20):
        dealt = deal(tuple(Manner), 8, np.random.default_rng(seed))
        assert all(dealt.count(each) == 2 for each in Manner)
        firsts.add(dealt[0])
    assert firsts == set(Manner)


@pytest.mark.parametrize("wrong", ["evade", "", "runs,", "mixed,runs"])
def test_a_manner_that_is_none_is_named_with_what_is_allowed(wrong: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="allowed: stubborn, evades, wanders"):
        parse_manners(wrong)


@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=3, max_size=6),
    st.tuples(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
)
def test_who_evades_sees_a_disc_that_covers_the_body_and_moves_as_its_middle_does(
    corners: list[tuple[float, float]], pose: tuple[float, float, float]
) -> None:
    heading, omega, lateral = pose
    disc = BodyDisc.around(corners).moving((1.0, 2.0, heading), (0.4, lateral, omega))
    c, s = math.cos(heading), math.sin(heading)
    for x, y in corners:
        at = 1.0 + c * x - s * y, 2.0 + s * x + c * y
        assert math.dist(at, disc[:2]) <= disc.radius_m + 1e-9
    step_s = 1e-6
    moved = (1.0 + (0.4 * c - lateral * s) * step_s, 2.0 + (0.4 * s + lateral * c) * step_s)
    after = BodyDisc.around(corners).moving(
        (*moved, heading + omega * step_s), (0.4, lateral, omega)
    )
    assert (after.x_m - disc.x_m) / step_s == pytest.approx(disc.vx_m_s, abs=1e-4)
    assert (after.y_m - disc.y_m) / step_s == pytest.approx(disc.vy_m_s, abs=1e-4)


def worlds(tmp_path: Path, words: str) -> Iterator[World]:
    file = tmp_path / "room.toml"
    text = (FLAT_FILE).read_text() + f"[[person]]\npoints = [[3.0, 1.0], [3.0, 3.0]]\n{words}\n"
    file.write_text(text)
    yield load_world(file)


FLAT_FILE = Path(__file__).parents[3] / "configs" / "worlds" / "flat.toml"


@pytest.mark.parametrize("manner", list(Manner))
def test_who_is_in_a_worlds_file_has_the_manner_it_says(manner: Manner, tmp_path: Path) -> None:
    (world,) = worlds(tmp_path, f'manner = "{manner}"')
    assert world.people[0].manner is manner
    places = walked(People(world, 0, np.random.default_rng(4)), 20.0)
    assert np.ptp(places, axis=0).max() > 1.0


def test_a_worlds_file_with_a_wrong_manner_is_refused_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=r'person.0.manner: .*did you mean "evades"'):
        next(worlds(tmp_path, 'manner = "evade"'))


def test_who_would_roam_from_within_a_wall_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    file.write_text(
        FLAT_FILE.read_text() + '[[person]]\npoints = [[0.05, 0.05], [3.0, 3.0]]\nmanner = "runs"\n'
    )
    with pytest.raises(SimulationError, match="a person begins at x 0"):
        People(load_world(file), 0, np.random.default_rng(1))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_who_lines_up_stands_at_the_last_point_each_time(sign):
    walker = Stubborn(np.array([(0.0, 0.0), (0.0, 2.0), (0.0, 0.0)]), 1.0, stands_s=3.0)
    walker.sign = sign
    places = walked(crowd(walker), 14.5)[:, 0, 1]
    # 2 s there, 3 s at rest, 4 s back and there again, and 3 s at rest.
    at_rest = np.abs(places - 2.0) < 0.011
    begins = np.flatnonzero(np.diff(at_rest.astype(int)) == 1) * STEP_S
    assert begins == pytest.approx([2.0, 9.0], abs=0.05)
    assert at_rest.sum() * STEP_S == pytest.approx(6.0, abs=0.1)


def test_only_who_is_stubborn_lines_up():
    text = "points = [[1.0, 1.0], [2.0, 1.0]]\nstands_s = 5.0\nmanner = 'runs'\n"
    with pytest.raises(ValidationError, match="stands_s: runs found, manner stubborn needed"):
        TypeAdapter(Person).validate_python(tomllib.loads(text))
