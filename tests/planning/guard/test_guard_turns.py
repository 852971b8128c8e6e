"""A robot with a lidar that drives and turns at random in a narrow place touches nothing.

It comes to rest between two motions: the guard judges the arc that is asked for.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.messages.requests import VelocityRequest
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput
from robotctl.planning.behave.behaviours.guarded import limited
from robotctl.planning.behave.remote_velocity import guided_velocity
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.obstacle_guard import GuardStep, ObstacleGuard
from tests.planning.map.rays import box, ranges

CONFIG = GuardConfig(nose_m=0.24)
FRONT, REAR, SIDE = 0.24, -0.24, 0.18
ROOM = [*box(0.0, 0.0, 2.0, 1.6), *box(0.0, 0.0, 0.4, 0.5), *box(1.3, 1.2, 1.5, 1.6)]
STEP_S, DELAY_STEPS = 0.05, 2


def wall_points(walls):
    """Return points on walls, 5 mm apart."""
    return np.concatenate(
        [np.linspace(w[:2], w[2:], 2 + int(math.dist(w[:2], w[2:]) / 0.005)) for w in walls]
    )


def touches(pose, points):
    """Return whether a point lies within the body."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    x, y = ((points - (pose.x_m, pose.y_m)) @ np.array([[c, -s], [s, c]])).T
    return bool(np.any((x < FRONT) & (x > REAR) & (np.abs(y) < SIDE)))


def lidar_points(pose):
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    away = ranges(pose.x_m, pose.y_m, angles + pose.theta_rad, ROOM)
    return np.stack([away * np.cos(angles), away * np.sin(angles)], axis=1)


def towards(now, wanted, most):
    return now + min(max(wanted - now, -most), most)


@pytest.mark.parametrize("seed", range(6))
def test_whoever_drives_and_turns_at_random_touches_nothing(seed):
    rng = np.random.default_rng(seed)
    points = wall_points(ROOM)
    guard = ObstacleGuard(CONFIG, ())
    reach = math.hypot(FRONT, SIDE)
    pose, v, omega = SE2(1.0, 0.8, rng.uniform(-3.0, 3.0)), 0.0, 0.0
    commands = [(0.0, 0.0)] * DELAY_STEPS
    wish, turned, driven = BehaviourOutput(0.0, 0.0), 0.0, 0.0
    for k in range(600):
        if k % 30 == 15:
            wish = BehaviourOutput(0.0, 0.0)
        elif k % 30 == 0:
            kind = rng.integers(3)
            speed = rng.choice([-1, 1]) * rng.uniform(0.1, 0.6)
            wish = BehaviourOutput(
                speed * (kind > 0), rng.choice([-1, 1]) * rng.uniform(0.3, 2.0) * (kind != 1)
            )
        guard.observe((), (), (), lidar_points(pose))
        step, _ = limited(wish, guard)
        commands.append((step.v_m_s, step.omega_rad_s))
        late_v, late_omega = commands.pop(0)
        for _ in range(5):
            dt = STEP_S / 5
            v = towards(v, late_v, CONFIG.deceleration_m_s2 * dt)
            omega = towards(omega, late_omega, CONFIG.deceleration_m_s2 / reach * dt)
            pose = pose @ SE2(v * dt, 0.0, omega * dt)
            turned += abs(omega) * dt
            driven += abs(v) * dt
            assert not touches(pose, points)
    assert turned > 1.0
    assert driven > 0.2


def test_a_turn_on_the_spot_is_slowed_and_waits_before_what_it_would_touch():
    guard = ObstacleGuard(CONFIG, ())
    guard.observe((), (), (), np.array([[0.0, 0.29]]))  # the front left corner comes there
    slowed, verdict = limited(BehaviourOutput(0.0, 3.0, text="turning"), guard)
    assert slowed.omega_rad_s == pytest.approx(verdict.v_max_m_s / guard.reach_m)
    assert 0.0 < slowed.omega_rad_s < 3.0
    assert slowed.text == "turning"
    slow = BehaviourOutput(0.0, 0.1)
    assert limited(slow, guard)[0] == slow
    guard.observe((), (), (), np.array([[0.15, 0.24]]))
    waits, _ = limited(BehaviourOutput(0.0, 3.0), guard)
    assert waits[:2] == (0.0, 0.0)
    assert waits.text == "waiting: something is at x 0.15 m, y 0.24 m of the robot"
    away = BehaviourOutput(0.0, -0.3)
    assert limited(away, guard)[0] == away


@pytest.mark.parametrize(("omega", "turns"), [(-0.3, True), (0.3, False)])
def test_a_robot_that_is_blocked_ahead_turns_where_it_can(omega, turns):
    guard = ObstacleGuard(CONFIG, ())
    guard.observe((), (), (), np.array([[0.3, 0.0], [0.15, 0.24]]))
    wish = VelocityRequest(10**12, 0.3, omega)
    drive = DifferentialDrive("differential", 0.3, 0.05, 2400)
    step, _ = limited(guided_velocity(wish, 0.0, drive, guard, 0), guard)
    assert step.v_m_s == 0.0
    assert step.omega_rad_s == (omega if turns else 0.0)


SONAR_AHEAD = (SonarMount("front", 0.2, 0.0, 0.0),)


def test_a_robot_whose_lidar_is_silent_stands_where_no_sonar_looks():
    alone = ObstacleGuard(CONFIG, (), has_lidar=True)
    with_sonar = ObstacleGuard(CONFIG, SONAR_AHEAD, has_lidar=True)
    blind = GuardStep(0.0, "the lidar gives no scans")
    for points in (None, np.empty((0, 2)), None):
        alone.observe((), (), (), points)
        with_sonar.observe((3.0,), (True,), (), points)
        seen = points is not None
        for motion in ((0.3, 0.0), (-0.3, 0.1), (0.0, 0.5)):
            assert (alone.step(*motion) == blind) is not seen
        assert with_sonar.step(0.3) != blind
        assert (with_sonar.step(-0.3) == blind) is not seen
        assert with_sonar.step(0.0, 0.5) != blind
    waits, _ = limited(BehaviourOutput(0.0, 0.5), alone)
    assert waits == BehaviourOutput(0.0, 0.0, text="waiting: the lidar gives no scans")


def test_a_robot_without_a_lidar_waits_for_none():
    guard = ObstacleGuard(CONFIG, ())
    guard.observe((), ())
    assert guard.step(0.3).v_max_m_s == guard.step(0.0, 1.0).v_max_m_s == math.inf
