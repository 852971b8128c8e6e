from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.wall_following import (
    WallFollowConfig,
    WallFollower,
    critically_damped,
    wheel_speeds,
)

DT = 0.005
SONAR_EVERY = 10  # 50 ms
TRACK = 0.3
SIDES = {"left": 1.0, "right": -1.0}


class Room:
    """A wall along the x axis, at y = 0, and a robot on the right side of it or the left."""

    def __init__(self, side, distance, heading=0.0):
        self.sign = SIDES[side]
        self.y, self.theta = -self.sign * distance, heading
        self.x = 0.0

    @property
    def distance(self):
        return -self.sign * self.y

    def move(self, v, omega):
        self.theta += omega * DT
        self.x += v * math.cos(self.theta - 0.5 * omega * DT) * DT
        self.y += v * math.sin(self.theta - 0.5 * omega * DT) * DT


def follow(config, room, v=0.3, metres=5.0, reading=lambda _k, distance: distance):
    """Distances and headings on the way; the sonar gives a new reading every 50 ms."""
    follower = WallFollower(config)
    out = []
    for k in range(round(metres / abs(v) / DT)):
        z = reading(k, room.distance) if k % SONAR_EVERY == 0 else math.nan
        room.move(v, follower.step(z, v, DT))
        out.append((room.distance, room.theta))
    return np.array(out), follower


def config_for(side, length=0.5, **options):
    gains = critically_damped(length)
    return WallFollowConfig(side, 0.5, gains.kp, gains.kd, **options)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("v", [0.15, 0.3, 0.6, -0.3])
def test_the_error_falls_as_a_critically_damped_system_over_the_path(side, v):
    length = 0.5
    out, _ = follow(config_for(side, length), Room(side, 0.6), v)
    path = np.arange(1, len(out) + 1) * abs(v) * DT
    closed_form = 0.1 * (1.0 + path / length) * np.exp(-path / length)
    np.testing.assert_allclose(out[:, 0] - 0.5, closed_form, atol=0.006)


@pytest.mark.parametrize("side", ["left", "right"])
def test_too_far_turns_towards_the_wall_and_too_near_away_from_it(side):
    towards = SIDES[side]
    assert WallFollower(config_for(side)).step(0.8, 0.3, DT) * towards > 0.0
    assert WallFollower(config_for(side)).step(0.3, 0.3, DT) * towards < 0.0


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("distance", [0.25, 0.5, 1.0, 1.6])
@pytest.mark.parametrize("heading", [-0.35, 0.0, 0.35])
@pytest.mark.parametrize("v", [0.3, -0.3])
def test_it_settles_from_far_and_near_without_touching_the_wall(side, distance, heading, v):
    out, follower = follow(config_for(side), Room(side, distance, heading), v, metres=8.0)
    assert abs(out[-1, 0] - 0.5) < 0.01
    assert abs(out[-1, 1]) < 0.02
    assert np.min(out[:, 0]) > 0.12
    assert not follower.lost


def test_a_far_wall_is_approached_no_steeper_than_allowed():
    out, _ = follow(config_for("left", approach_max_rad=0.3), Room("left", 1.9), metres=6.0)
    assert np.max(np.abs(out[:, 1])) < 0.3 * 1.05
    assert np.min(out[:, 0]) > 0.48


@pytest.mark.parametrize("side", ["left", "right"])
def test_noise_outliers_and_lost_echoes_leave_it_on_its_line(side):
    rng = np.random.default_rng(11)

    def reading(_k, distance):
        kind = rng.random()
        if kind < 0.1:
            return math.inf
        if kind < 0.2:
            return rng.uniform(0.02, 3.0)
        return distance + rng.normal(0.0, 0.01)

    out, follower = follow(config_for(side), Room(side, 0.6), metres=20.0, reading=reading)
    settled = out[len(out) // 4 :, 0]
    assert np.std(settled) < 0.01
    assert np.max(np.abs(settled - 0.5)) < 0.04
    assert not follower.lost


def test_a_gap_of_half_a_second_is_bridged_on_course():
    def reading(k, distance):
        return math.inf if 1000 < k < 1100 else distance

    out, follower = follow(config_for("left"), Room("left", 0.5), metres=3.0, reading=reading)
    assert np.max(np.abs(out[:, 0] - 0.5)) < 0.005
    assert not follower.lost


def test_a_wall_that_ends_is_lost_and_the_robot_goes_straight_on():
    def reading(k, distance):
        return distance if k < 800 else math.inf

    config = config_for("left", lost_after_s=1.0)
    room = Room("left", 0.5)
    out, follower = follow(config, room, metres=3.0, reading=reading)
    assert follower.lost
    assert follower.step(math.nan, 0.3, DT) == 0.0
    assert abs(out[-1, 1]) < 0.01


def test_a_wall_that_jumps_is_taken_up_when_the_readings_agree():
    def reading(k, distance):
        return distance if k < 1000 else distance - 0.2  # a cupboard along the wall

    config = config_for("left", lost_after_s=60.0)
    out, follower = follow(config, Room("left", 0.5), metres=6.0, reading=reading)
    just_after = out[1000:1050, 0]
    assert np.max(np.abs(just_after - 0.5)) < 0.003
    assert out[-1, 0] == pytest.approx(0.7, abs=0.01)
    assert not follower.lost


def test_it_is_lost_before_the_first_reading_and_found_with_it():
    follower = WallFollower(config_for("left"))
    assert follower.lost
    assert follower.step(math.nan, 0.3, DT) == 0.0
    assert follower.lost
    follower.step(0.6, 0.3, DT)
    assert not follower.lost
    follower.reset()
    assert follower.lost


def test_a_wall_found_again_is_taken_as_parallel():
    follower = WallFollower(config_for("left", lost_after_s=0.5))
    follower.step(0.5, 0.3, DT)
    for _ in range(200):
        follower.step(math.nan, 0.0, DT, 0.5)
    assert follower.lost
    assert follower.heading_est_rad == pytest.approx(0.5, abs=0.01)
    follower.step(0.7, 0.0, DT, 0.0)
    assert (follower.distance_est_m, follower.heading_est_rad) == (0.7, 0.0)


def test_an_echo_from_beyond_the_range_is_no_wall():
    follower = WallFollower(config_for("left", range_max_m=1.0))
    assert follower.step(1.5, 0.3, DT) == 0.0
    assert follower.lost


def test_readings_repeated_at_the_control_rate_do_no_harm():
    config, room = config_for("right"), Room("right", 0.7)
    follower, held = WallFollower(config), 0.7
    for k in range(4000):
        held = room.distance if k % SONAR_EVERY == 0 else held
        room.move(0.3, follower.step(held, 0.3, DT))
    assert room.distance == pytest.approx(0.5, abs=0.01)


def test_a_measured_turning_rate_replaces_the_commanded_one():
    # The actuator gives half of what was asked for; the observer is told.
    config, room = config_for("left"), Room("left", 0.7)
    follower, omega = WallFollower(config), 0.0
    for k in range(6000):
        z = room.distance if k % SONAR_EVERY == 0 else math.nan
        omega = 0.5 * follower.step(z, 0.3, DT, omega)
        room.move(0.3, omega)
        assert abs(follower.heading_est_rad - room.theta) < 0.05
    assert room.distance == pytest.approx(0.5, abs=0.01)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(), st.floats(-1.0, 1.0)), min_size=1, max_size=50))
def test_any_readings_give_a_bounded_finite_turning_rate(steps):
    follower = WallFollower(config_for("left", omega_max_rad_s=0.8))
    assert all(abs(follower.step(z, v, DT)) <= 0.8 for z, v in steps)


@pytest.mark.parametrize(("v", "dt"), [(math.nan, DT), (math.inf, DT), (0.3, 0.0), (0.3, math.nan)])
def test_unusable_speed_or_time_gives_zero_and_changes_nothing(v, dt):
    follower = WallFollower(config_for("left"))
    follower.step(0.7, 0.3, DT)
    before = follower.distance_est_m, follower.heading_est_rad
    assert follower.step(0.7, v, dt) == 0.0
    assert (follower.distance_est_m, follower.heading_est_rad) == before


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_wheel_speeds_are_those_of_the_notes(side, sign):
    left, right = wheel_speeds(0.3, 0.7, 0.5, 2.0, side)
    assert right - left == pytest.approx(sign * 2.0 * 0.2)
    assert 0.5 * (left + right) == pytest.approx(0.3)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_notes_law_alone_swings_undamped_with_the_predicted_frequency(side):
    v, kp = 0.3, 1.0
    room, distances = Room(side, 0.52), []
    for _ in range(12_000):
        left, right = wheel_speeds(v, room.distance, 0.5, kp, side)
        room.move(v, (right - left) / TRACK)
        distances.append(room.distance)
    error = np.array(distances) - 0.5
    assert np.max(np.abs(error[-3000:])) > 0.9 * 0.02
    crossings = np.flatnonzero(np.diff(np.sign(error)) > 0)
    period = np.mean(np.diff(crossings)) * DT
    assert 2.0 * math.pi / period == pytest.approx(math.sqrt(v * kp / TRACK), rel=0.02)


def test_the_notes_law_with_a_late_sonar_swings_up():
    v, kp, late = 0.3, 1.0, 20
    room = Room("left", 0.52)
    distances = [0.52] * (late + 1)
    for _ in range(12_000):
        left, right = wheel_speeds(v, distances[-late], 0.5, kp)
        room.move(v, (right - left) / TRACK)
        distances.append(room.distance)
    assert np.max(np.abs(np.array(distances[-3000:]) - 0.5)) > 2.0 * 0.02


def test_critical_damping_means_a_double_pole():
    kp, kd = critically_damped(0.4)
    np.testing.assert_allclose(np.roots([1.0, kd, kp]), [-2.5, -2.5], rtol=1e-6)
    with pytest.raises(ValueError, match=r"^length_m: "):
        critically_damped(0.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("side", "front"),
        ("distance_m", 0.0),
        ("kp", math.nan),
        ("kd", -1.0),
        ("omega_max_rad_s", 0.0),
        ("approach_max_rad", 1.6),
        ("range_max_m", 0.4),
        ("reacquire_s", -1.0),
        ("gate_m", 0.0),
    ],
)
def test_configuration_refuses_values_out_of_range(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        WallFollowConfig(**({"side": "left", "distance_m": 0.5} | {name: value}))
