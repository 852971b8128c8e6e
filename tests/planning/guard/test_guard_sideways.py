"""A mecanum robot told to drive anywhere, sideways too, touches nothing that it has seen."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, StickRequest, VelocityRequest
from robotctl.model.drives.drives import DifferentialDrive, MecanumDrive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.behave.remote_velocity import guided_velocity, stick_velocity
from robotctl.planning.config import GuardConfig, NavigationConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.navigation_step import NavigationInputs
from robotctl.planning.navigator import Navigator
from tests.planning.conftest import cast

DRIVE = MecanumDrive("mecanum", 0.40, 0.36, 0.076, 8192)
LIMITS = LimitsConfig(0.8, 1.8, 2.0, 6.0, 30.0, 100.0, vy_max_m_s=0.6)
GUARD = GuardConfig(nose_m=0.254, half_width_m=0.225, deceleration_m_s2=1.5)
NOSE, SIDE = 0.254, 0.215  # the body itself
LIDAR_X = 0.12
FRONT = np.radians(np.linspace(-135.0, 135.0, 271))
"""Beams of a lidar that sees nothing behind."""
ROUND = np.radians(np.linspace(-180.0, 179.0, 360))
FAR = SE2(0.0, 0.0, 0.0)
LATER = 10**15
DT = 0.01


def post(x, y, half=0.06):
    """Return the sides of a square post."""
    a, b, c, d = (
        (x - half, y - half),
        (x + half, y - half),
        (x + half, y + half),
        (x - half, y + half),
    )
    return [(*p, *q) for p, q in ((a, b), (b, c), (c, d), (d, a))]


def room(*posts, half=3.0, half_post=0.06):
    walls = [each for x, y in posts for each in post(x, y, half_post)]
    return np.array(walls + post(0.0, 0.0, half))


class Strafer:
    """A robot of perfect wheels and odometry among walls, at 20 Hz with 100 Hz motion."""

    def __init__(self, walls, pose, beams=FRONT, a=2.0):
        self.walls, self.pose, self.now_ns = walls, pose, 0
        self.beams = beams
        self.twist = Twist(0.0, 0.0)
        self.gains = a, 3.0 * a, a
        guard = replace(GUARD, deceleration_m_s2=0.75 * a)
        limits = replace(LIMITS, a_max_m_s2=a, alpha_max_rad_s2=3.0 * a)
        self.navigator = Navigator(
            NavigationConfig(guard=guard), DRIVE, limits, (), None, FAR, lidars=1
        )
        self.touched = 0
        self.closest_m = math.inf
        self.navigator.step(self.inputs(ModeRequest(Mode.GUIDED)), 0)

    def scan(self):
        """Return what the lidar sees, from ahead of the middle."""
        x, y = self.pose.apply(LIDAR_X, 0.0)
        angles = self.beams + self.pose.theta_rad
        hits = cast(self.walls, np.full(len(angles), x), np.full(len(angles), y), angles)[:, 0]
        return RangeScan(self.now_ns, self.beams, hits, 10.0, LIDAR_X)

    def inputs(self, *requests):
        scans = ((self.pose, self.scan()),)
        return NavigationInputs(self.pose, self.twist, (), (), True, requests, scans=scans)

    def gap(self):
        """Return how far the body's sides are from the nearest point of the walls [m]."""
        along = np.linspace(0.0, 1.0, 60)[:, None]
        near = self.walls[:-4] if len(self.walls) > 4 else self.walls
        points = np.concatenate([w[:2] + along * (w[2:] - w[:2]) for w in near])
        x, y = (points - (self.pose.x_m, self.pose.y_m)).T
        c, s = math.cos(self.pose.theta_rad), math.sin(self.pose.theta_rad)
        dx, dy = np.abs(c * x + s * y) - NOSE, np.abs(c * y - s * x) - SIDE
        outside = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0))
        return float(np.where((dx < 0.0) & (dy < 0.0), -1.0, outside).min())

    def step(self, *requests):
        out = self.navigator.step(self.inputs(*requests), self.now_ns)
        wanted = Twist(out.v_m_s, out.omega_rad_s, out.vy_m_s)
        for _ in range(5):
            self.twist = Twist(
                *(
                    min(max(to, now - gain * DT), now + gain * DT)
                    for now, to, gain in zip(self.twist, wanted, self.gains, strict=True)
                )
            )
            half = self.pose.theta_rad + 0.5 * self.twist.omega_rad_s * DT
            c, s = math.cos(half), math.sin(half)
            v, omega, vy = self.twist
            self.pose = SE2(
                self.pose.x_m + (c * v - s * vy) * DT,
                self.pose.y_m + (s * v + c * vy) * DT,
                self.pose.theta_rad + omega * DT,
            )
        self.now_ns += 50_000_000
        gap = self.gap()
        self.touched += gap <= 0.0
        self.closest_m = min(self.closest_m, gap)
        return out


@pytest.mark.parametrize("vy", [0.6, -0.6, 0.2])
@pytest.mark.parametrize("along", [-0.24, 0.0, 0.24])
def test_it_stops_sideways_before_a_post_beside_it(vy, along):
    side = math.copysign(1.0, vy)
    robot = Strafer(room((along, side * 1.0)), SE2())
    for _ in range(160):
        robot.step(VelocityRequest(LATER, 0.0, 0.0, vy_m_s=vy))
    assert robot.twist.vy_m_s == pytest.approx(0.0, abs=1e-3)
    assert 0.05 < robot.closest_m < 0.2  # it went near, and not nearer


def test_beside_a_post_it_still_slides_away_and_along():
    for v, vy in ((0.3, 0.0), (0.0, -0.3), (-0.3, -0.3)):
        robot = Strafer(room((0.0, 0.4)), SE2())
        for _ in range(20):
            robot.step(VelocityRequest(LATER, v, 0.0, vy_m_s=vy))
        assert robot.pose.x_m == pytest.approx(v * 0.9, abs=0.08)
        assert robot.pose.y_m == pytest.approx(vy * 0.9, abs=0.08)


def test_a_post_that_it_has_passed_is_remembered_where_the_lidar_does_not_see():
    robot = Strafer(room((0.3, 0.28), half_post=0.02), SE2())
    while robot.pose.x_m < 0.52:  # the post is now beside the tail
        robot.step(VelocityRequest(LATER, 0.3, 0.0))
    beside = robot.scan().points_base() - (0.3 - robot.pose.x_m, 0.28)
    assert np.hypot(*beside.T).min() > 0.5
    for _ in range(60):
        robot.step(VelocityRequest(LATER, 0.0, 0.0, vy_m_s=0.4))
    assert robot.touched == 0
    assert robot.pose.y_m < 0.04
    for _ in range(60):
        robot.step(VelocityRequest(LATER, 0.0, 0.0, vy_m_s=-0.4))
    assert robot.pose.y_m < -0.5


@pytest.mark.parametrize(("heading", "turn"), [(None, 0.0), (None, 0.5), (2.0, 0.0)])
def test_a_velocity_of_the_world_is_driven_whatever_the_heading(heading, turn):
    robot = Strafer(room(), SE2(0.0, 0.0, 0.7))
    for _ in range(60):
        robot.step(VelocityRequest(LATER, 0.1, turn, heading, 0.4, in_world=True))
    assert robot.pose.x_m == pytest.approx(0.3, abs=0.06)
    assert robot.pose.y_m == pytest.approx(1.2, abs=0.08)
    wanted = 0.7 + 3.0 * turn if heading is None else heading
    assert robot.pose.theta_rad == pytest.approx(wanted, abs=0.1)


def test_no_other_robot_is_told_to_move_sideways():
    drive = DifferentialDrive("differential", 0.3, 0.05, 2400)
    guard = ObstacleGuard(GUARD, ())
    guard.observe((), ())
    for request in (
        VelocityRequest(LATER, 0.3, 0.1, vy_m_s=0.4),
        VelocityRequest(LATER, 0.3, 0.1, None, 0.4, in_world=True),
    ):
        assert guided_velocity(request, 0.0, drive, guard, 0).twist == Twist(0.3, 0.1)
    sticks = StickRequest(LATER, 1.0, 0.0, 1.0)
    assert stick_velocity(sticks, LIMITS, drive, 0).twist == Twist(0.8, 0.0)
    assert stick_velocity(sticks, LIMITS, DRIVE, 0).twist == Twist(0.8, 0.0, 0.6)


@pytest.mark.parametrize("room_m", [0.1, 0.2, 0.24, 0.28, 0.32])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_told_to_drive_ahead_while_it_slides_it_does_not_cut_a_corner(room_m, side):
    # The post is beyond the nose for who slides, and beside the way for who drives ahead.
    robot = Strafer(room((0.32, side * 1.5), half_post=0.02), SE2(), a=0.5)
    while side * robot.pose.y_m < 1.48 - GUARD.half_width_m - room_m - 0.03:
        robot.step(VelocityRequest(LATER, 0.0, 0.0, vy_m_s=side * 0.6))
    assert side * robot.twist.vy_m_s > 0.5
    for _ in range(60):
        robot.step(VelocityRequest(LATER, 0.8, 0.0))
    assert robot.touched == 0


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    theta=st.floats(-math.pi, math.pi),
    bearing=st.floats(-math.pi, math.pi),
    away_m=st.floats(0.55, 1.4),
    speed=st.floats(0.1, 0.8),
    course=st.floats(-math.pi, math.pi),
    curvature=st.floats(-2.0, 2.0),
)
@example(theta=0.0, bearing=1.57, away_m=0.6, speed=0.6, course=1.57, curvature=0.0)
# The corner of the post leaves the view beside the tail.
@example(theta=0.0, bearing=2.0, away_m=0.75, speed=0.25, course=2.0, curvature=-1.0)
# Round in a circle of 1 m, and tail first back to the post.
@example(theta=0.0, bearing=0.0, away_m=0.6875, speed=0.5, course=3.125, curvature=2.0)
def test_no_motion_asked_for_touches_a_post_that_it_has_seen(
    theta, bearing, away_m, speed, course, curvature
):
    at = away_m * math.cos(theta + bearing), away_m * math.sin(theta + bearing)
    robot = Strafer(room(at), SE2(0.0, 0.0, theta), FRONT if away_m < 0.9 else ROUND)
    if away_m < 0.9:  # what is behind is seen before
        for turn in (1.5,) * 40 + (-1.5,) * 40:
            robot.step(VelocityRequest(LATER, 0.0, turn))
    wish = VelocityRequest(
        LATER, speed * math.cos(course), curvature * speed, None, speed * math.sin(course)
    )
    for _ in range(100):
        robot.step(wish)
    assert robot.touched == 0


@pytest.mark.parametrize("seed", range(6))
def test_whoever_steers_at_random_among_posts_touches_nothing(seed):
    rng = random.Random(seed)
    walls = room(
        (0.9, 0.1), (-0.8, 0.7), (0.1, -1.0), (-0.9, -0.8), (0.7, 1.2), (1.3, -0.9), half=1.8
    )
    robot = Strafer(walls, SE2(0.0, 0.0, rng.uniform(-3.0, 3.0)), ROUND)
    while robot.now_ns < 20e9:
        v, vy = rng.uniform(-0.8, 0.8), rng.uniform(-0.6, 0.6)
        wish = VelocityRequest(LATER, v, rng.choice([0.0, rng.uniform(-1.8, 1.8)]), None, vy)
        for _ in range(rng.randint(3, 40)):
            robot.step(wish)
    assert robot.touched == 0
    assert robot.closest_m < 0.2
