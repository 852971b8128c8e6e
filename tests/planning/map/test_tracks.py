"""What moves by itself is found with its velocity; what only seems to move, as the robot drives, is
not.
"""

import math

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.config import TracksConfig
from robotctl.planning.map.tracks import MovingObstacles
from tests.planning.map.rays import box, scan

TENTH_NS = 100_000_000
WALLS = box(-6.0, -6.0, 6.0, 6.0)
POLES = [(4.0, 2.0, 0.1), (3.0, -2.5, 0.05)]
STARTS_S = 1.5


def drive(seed, v, swing, steps):
    """Return a winding path among boxes and poles that the robot does not touch."""
    rng = np.random.default_rng(seed)
    poses = [SE2()]
    for i in range(steps):
        omega = swing * math.sin(0.07 * i + seed)
        poses.append(poses[-1] @ SE2(0.1 * v, 0.0, 0.1 * omega))
    path = np.array([(pose.x_m, pose.y_m) for pose in poses])
    low, high = path.min(axis=0) - 3.0, path.max(axis=0) + 3.0
    walls, poles = box(*low, *high), []
    for _ in range(12):
        corner, size = rng.uniform(low, high), rng.uniform(0.2, 1.2, 2)
        away = np.maximum(np.maximum(corner - path, path - corner - size), 0.0)
        if np.hypot(*away.T).min() > 0.3:
            walls += box(*corner, *(corner + size))
    for _ in range(24):
        centre, radius = rng.uniform(low, high), rng.choice([0.02, 0.05, 0.1, 0.2])
        if np.hypot(*(path - centre).T).min() - radius > 0.3:
            poles.append((*centre, radius))
    return rng, poses, walls, poles


@pytest.mark.parametrize(
    ("v", "swing", "beams"), [(0.5, 0.5, 360), (1.0, 0.5, 1000), (0.5, 1.0, 360), (0.7, 0.2, 180)]
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_robot_that_drives_past_boxes_and_poles_sees_nothing_move(seed, v, swing, beams):
    rng, poses, walls, poles = drive(seed, v, swing, 80)
    obstacles = MovingObstacles()
    for i, pose in enumerate(poses):
        obstacles.step(pose, scan(pose, walls, poles, beams=beams, noise=rng), i * TENTH_NS)
        assert len(obstacles.moving(SE2())) == 0


def walk(person, seconds, robot_v=0.0, obstacles=None, seed=0):
    """Yield time [s], what moves, and place and velocity of a person, who starts after a while."""
    rng = np.random.default_rng(seed)
    obstacles = obstacles or MovingObstacles()
    for i in range(round(10 * seconds)):
        pose = SE2(0.1 * robot_v * i, 0.0, 0.05 * robot_v * i)
        discs, place, velocity = person(0.1 * i)
        seen = scan(pose, WALLS, [*POLES, *discs], noise=rng)
        obstacles.step(pose, seen, (i + 1) * TENTH_NS)
        yield 0.1 * i, obstacles.moving(SE2()), place, velocity


def round_person(speed, heading, x, stops_s=math.inf):
    """Return a person as a disc of 0.25 m."""
    ahead = np.array([math.cos(heading), math.sin(heading)])

    def at(time_s):
        walked_s = min(max(time_s - STARTS_S, 0.0), stops_s - STARTS_S)
        place = np.array([x, -0.3]) + speed * walked_s * ahead
        walks = STARTS_S <= time_s < stops_s
        return [(*place, 0.25)], place, speed * ahead * walks

    return at


@pytest.mark.parametrize("speed", [0.3, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("heading", [0.5 * math.pi, 2.2])
@pytest.mark.parametrize("robot_v", [0.0, 0.5])
def test_a_person_who_crosses_is_found_within_half_a_second(speed, heading, robot_v):
    person = round_person(speed, heading, 3.0)
    for time_s, moving, place, velocity in walk(person, 2.7, robot_v):
        if time_s < STARTS_S:
            assert len(moving) == 0
        elif time_s > STARTS_S + (0.49 if speed > 0.3 else 0.65):
            ((*found, radius),) = moving
            assert math.dist(found[:2], place) < 0.15
            assert math.dist(found[2:], velocity) < 0.2
            assert 0.2 <= radius < 0.4


@pytest.mark.parametrize("beside_m", [-0.05, 0.0, 0.12])
def test_who_walks_where_a_scan_begins_and_ends_is_one_person(beside_m):
    def person(time_s):
        place = np.array([-5.5 + 0.9 * max(time_s - STARTS_S, 0.0), beside_m])
        return [(*place, 0.22)], place, np.array([0.9, 0.0])

    for time_s, moving, place, _ in walk(person, 5.0):
        if time_s > STARTS_S + 1.0:
            assert len(moving) == 1
            assert math.dist(moving[0, :2], place) < 0.1


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5])
@pytest.mark.parametrize("heading", [0.5 * math.pi, 2.2])
def test_two_legs_are_one_person(speed, heading):
    ahead = np.array([math.cos(heading), math.sin(heading)])
    beside = 0.1 * np.array([-ahead[1], ahead[0]])

    def person(time_s):
        walked = speed * max(time_s - STARTS_S, 0.0)
        place = np.array([3.0, -0.3]) + walked * ahead
        stride = 0.2 * math.sin(math.tau * walked / 1.4) * ahead
        legs = [(*(place + beside + stride), 0.07), (*(place - beside - stride), 0.07)]
        return legs, place, speed * ahead * (time_s >= STARTS_S)

    found_s = math.inf
    for time_s, moving, place, velocity in walk(person, 2.8):
        assert len(moving) <= 1
        if len(moving):
            found_s = min(found_s, time_s - STARTS_S)
            assert math.dist(moving[0, :2], place) < 0.35
        if time_s > STARTS_S + 0.65:
            assert math.dist(moving[0, 2:4], velocity) < 0.25
    assert 0.0 <= found_s < 0.45


def predicted_off_m(rate_rad_s, seed):
    """Return how far off the place is a second after it was predicted, on average [m]."""

    def place_at(time_s):
        turned, walked_s = rate_rad_s * max(time_s - STARTS_S, 0.0), max(time_s - STARTS_S, 0.0)
        chord = 0.9 * walked_s * np.sinc(0.5 * turned / math.pi)
        ahead = 0.4 + 0.5 * turned
        return np.array([-2.5, -1.0]) + chord * np.array([math.cos(ahead), math.sin(ahead)])

    def person(time_s):
        place = place_at(time_s)
        return [(*place, 0.22)], place, np.zeros(2)

    off_m = []
    obstacles = MovingObstacles(TracksConfig(turn_s=1.0))
    for time_s, moving, _, _ in walk(person, 5.5, obstacles=obstacles, seed=seed):
        if time_s > STARTS_S + 1.5:
            ((x, y, vx, vy, _),) = moving
            off_m.append(math.dist((x + vx, y + vy), place_at(time_s + 1.0)))
    return np.mean(off_m)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("rate", [0.6, -0.6])
def test_who_turns_is_expected_to_turn_on(rate, seed):
    assert predicted_off_m(rate, seed) < 0.2  # straight on it would be 0.4 m with the filter's lag


@pytest.mark.parametrize("seed", [1, 2])
def test_who_goes_straight_is_expected_to_go_on(seed):
    assert predicted_off_m(0.0, seed) < 0.15


def test_a_person_who_stops_does_not_move_any_more():
    person = round_person(0.8, 0.5 * math.pi, 2.5, stops_s=3.0)
    for time_s, moving, _, _ in walk(person, 4.5):
        if 2.1 < time_s < 3.0:
            assert len(moving) == 1
        if time_s > 3.8:
            assert len(moving) == 0


def test_who_is_hidden_for_a_moment_moves_on_and_is_given_up_later():
    person = round_person(1.0, 0.5 * math.pi, 2.5)
    obstacles = MovingObstacles()
    for _ in walk(person, 2.5, obstacles=obstacles):
        pass
    before = obstacles.moving(SE2())
    hidden = scan(SE2(), [(1.0, -3.0, 1.0, 3.0)])
    obstacles.step(SE2(), hidden, 28 * TENTH_NS)
    after = obstacles.moving(SE2())
    assert after[:, 2:] == pytest.approx(before[:, 2:])
    assert after[:, :2] == pytest.approx(before[:, :2] + 0.3 * before[:, 2:4])
    obstacles.step(SE2(), hidden, 31 * TENTH_NS)
    assert len(obstacles.moving(SE2())) == 0


def test_what_the_map_explains_is_not_tracked():
    seen = MovingObstacles()
    person = round_person(1.0, 0.5 * math.pi, 2.5)
    for i in range(30):
        discs, _, _ = person(0.1 * i)
        here = scan(SE2(), WALLS, discs)
        seen.step(SE2(), here, (i + 1) * TENTH_NS, np.zeros(360, np.bool_))
        assert len(seen.moving(SE2())) == 0


def test_places_and_velocities_are_given_in_the_world():
    obstacles = MovingObstacles()
    for _ in walk(round_person(1.0, 0.5 * math.pi, 2.5), 2.5, obstacles=obstacles):
        pass
    ((x, y, vx, vy, radius),) = obstacles.moving(SE2())
    T_world_odom = SE2(3.0, -1.0, 2.0)
    ((*place, wx, wy, other),) = obstacles.moving(T_world_odom)
    assert place == pytest.approx(T_world_odom.apply(x, y))
    turned = SE2(0.0, 0.0, 2.0).apply(vx, vy)
    assert (wx, wy) == pytest.approx(turned)
    assert radius == other
    obstacles.reset()
    assert obstacles.moving(SE2()).shape == (0, 5)
