"""Who comes nearer is told from walls, and the guard stops the robot before they are there."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.echo_motion import STANDS, ApproachingEcho, EchoMotion
from robotctl.planning.guard.obstacle_guard import ObstacleGuard

DT_S = 0.05
FRONT = SonarMount("front", 0.2, 0.0, 0.0)
SIDE = SonarMount("right", 0.0, -0.16, -90.0)
CONFIG = GuardConfig(nose_m=0.2)


def noisy(rng, range_m):
    """Return a reading as sonars give it; one in fifty has nothing to do with the world."""
    if rng.random() < 0.02:
        return rng.uniform(0.02, 4.0)
    return range_m + rng.normal(0.0, 0.003 + 0.004 * range_m)


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 1.2), st.floats(-0.3, 0.6))
def test_the_speed_of_who_comes_nearer_is_known_within_half_a_second(seed, walks, drives):
    rng = np.random.default_rng(seed)
    motion, range_m = EchoMotion([FRONT]), 1.8
    for k in range(1, 13):
        range_m -= (walks + drives) * DT_S
        heard_ns = (round(k * DT_S * 1e9),)
        reading = range_m + rng.normal(0.0, 0.003 + 0.004 * range_m)
        (seen,) = motion.step((reading,), (True,), heard_ns, Twist(drives, 0.0))
    assert seen.range_m == pytest.approx(range_m, abs=0.1)
    assert seen.speed_m_s == pytest.approx(walks, abs=0.3)


@given(
    st.integers(0, 2**32 - 1),
    st.floats(-0.4, 0.8),
    st.floats(-1.5, 1.5),
    st.floats(-0.9, 0.9),
    st.sampled_from([0.0, 45.0, -45.0, 90.0]),
)
def test_a_wall_stands_however_the_robot_moves(seed, v, omega, theta, heading_deg):
    """The wall is at x = 2; of a cone of 25 degrees the ray that it meets least flatly counts."""
    rng = np.random.default_rng(seed)
    mount = SonarMount("sonar", 0.2, 0.1, heading_deg)
    motion, x, wrong = EchoMotion([mount]), 0.0, 0
    for k in range(1, 60):
        x += v * math.cos(theta) * DT_S
        theta += omega * DT_S
        bearing = math.remainder(theta + math.radians(heading_deg), math.tau)
        slant = max(abs(bearing) - math.radians(12.5), 0.0)
        sensor_x = x + 0.2 * math.cos(theta) - 0.1 * math.sin(theta)
        range_m = (2.0 - sensor_x) / math.cos(slant)
        reading = math.inf
        if slant < math.radians(35.0) and 0.05 < range_m < 4.0:
            reading = noisy(rng, range_m)
        heard_ns = (round(k * DT_S * 1e9),)
        wrong += motion.step((reading,), (True,), heard_ns, Twist(v, omega)) != (STANDS,)
    assert wrong <= 10  # a wild reading within 20 cm counts for a quarter of a second


@pytest.mark.parametrize("walks", [0.6, 0.9, 1.2])
def test_the_robot_stands_when_somebody_who_comes_towards_it_is_there(walks):
    guard, motion = ObstacleGuard(CONFIG, [FRONT]), EchoMotion([FRONT])
    gap_m, v, commands = 2.0, 0.4, [0.4] * 2
    for k in range(1, 200):
        heard_ns = (round(k * DT_S * 1e9),)
        seen = motion.step((gap_m,), (True,), heard_ns, Twist(v, 0.0))
        guard.observe((gap_m,), (True,), approaches=seen)
        commands.append(min(0.4, guard.step(0.4).v_max_m_s))
        v = max(commands[-3], v - 0.8 * DT_S)  # a late and slow brake
        gap_m -= (walks + v) * DT_S
        if gap_m <= 0.0:
            break
    assert gap_m <= 0.0
    assert v < 0.05


def test_a_robot_that_passes_somebody_at_its_side_need_not_stop_in_their_way():
    guard = ObstacleGuard(CONFIG, [FRONT, SIDE])
    guard.observe((4.0, 0.5), (True, True), approaches=(STANDS, ApproachingEcho(0.5, 0.7)))
    for omega in (-0.01, -0.05, -0.1):
        assert guard.step(0.4, omega).v_max_m_s >= 0.4
    towards = guard.step(0.4, -1.0)
    assert towards.v_max_m_s < 0.25
    assert "right sees something that may come nearer" in towards.obstacle


def test_who_comes_nearer_and_leaves_the_beam_is_expected_beside_it_for_a_second():
    guard, motion, still = ObstacleGuard(CONFIG, [FRONT]), EchoMotion([FRONT]), Twist(0.0, 0.0)
    for k in range(1, 28):
        motion.step((2.0 - 0.05 * k,), (True,), (k * 50_000_000,), still)
    for k in range(28, 60):
        seen = motion.step((3.0,), (True,), (k * 50_000_000,), still)
        guard.observe((3.0,), (True,), approaches=seen)
        allowed = guard.step(0.4)
        if k < 46:
            assert seen[0].range_m == pytest.approx(max(2.0 - 0.05 * k, 0.0), abs=0.05)
            assert allowed.v_max_m_s < 0.2
            assert "front sees something that may come nearer" in allowed.obstacle
    assert seen == (STANDS,)
    assert allowed.v_max_m_s > 1.0


def test_a_sonar_that_falls_silent_knows_nothing_any_more():
    motion, still = EchoMotion([FRONT]), Twist(0.0, 0.0)
    for k in range(1, 12):
        motion.step((3.0 - 0.05 * k,), (True,), (k * 50_000_000,), still)
    assert motion.step((2.45,), (False,), (550_000_000,), still)[0].speed_m_s > 0.7
    assert motion.step((math.inf,), (True,), (1_000_000_000,), still) == (STANDS,)


def test_what_may_move_is_expected_to_walk_unless_it_goes_away():
    seen = (STANDS, STANDS, ApproachingEcho(0.5, -0.6), ApproachingEcho(0.7, 1.1))
    motion, may_move = EchoMotion([FRONT] * 4), (True, False, True, True)
    found = motion.expect(seen, (0.4, 0.5, 0.5, 0.7), may_move, 1_000_000_000)
    assert found[0].range_m == 0.4
    assert found[0].speed_m_s > 0.5
    assert found[1:] == seen[1:]


def test_who_crosses_a_beam_may_be_beside_it_for_a_while_and_a_thing_that_stood_there_is_not():
    motion, walls = EchoMotion([FRONT]), (2.5,)
    (crosses,) = motion.expect((STANDS,), (0.6,), (True,), 1_000_000_000)
    (beside,) = motion.expect((STANDS,), walls, (False,), 1_300_000_000)
    assert beside.speed_m_s == crosses.speed_m_s
    assert beside.range_m == pytest.approx(0.6 - 0.3 * crosses.speed_m_s)
    assert motion.expect((STANDS,), walls, (False,), 2_100_000_000) == (STANDS,)


def test_who_leaves_a_beam_beside_the_robot_may_stand_there_for_longer():
    motion, walls = EchoMotion([FRONT]), (2.5,)
    motion.expect((STANDS,), (0.08,), (True,), 1_000_000_000)
    (beside,) = motion.expect((STANDS,), walls, (False,), 3_900_000_000)
    assert beside.range_m == 0.0
    assert beside.speed_m_s > 0.5
    assert motion.expect((STANDS,), walls, (False,), 4_100_000_000) == (STANDS,)


def test_who_comes_up_to_the_robot_and_leaves_the_beam_may_stand_there_for_longer():
    motion, still = EchoMotion([FRONT]), Twist(0.0, 0.0)
    for k in range(1, 38):
        motion.step((2.0 - 0.05 * k,), (True,), (k * 50_000_000,), still)
    found = {
        k: motion.step((3.0,), (True,), (k * 50_000_000,), still)[0].speed_m_s > 0.7
        for k in range(38, 110)
    }
    left_s = 37 * DT_S
    assert all(found[k] for k in found if k * DT_S - left_s < 2.9)
    assert not any(found[k] for k in found if k * DT_S - left_s > 3.1)
