"""The fence's guard: a robot that follows it stays within, whatever is asked of it."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.fence_clearance import body_clearance
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.safety.fence.fence_guard import MARGIN_M, FenceGuard
from robotctl.safety.fence.prediction import MotionNow

BODY = Footprint.rectangle(-0.2, 0.2, 0.18)
PERIOD_S, LIFE_S, LATENCY_S, TICK_S = 0.05, 0.2, 0.02, 0.005
ROOM = ((-3.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-3.0, 2.0))


class Driven:
    """A robot that follows the set-point limiter exactly, with commands that come late."""

    def __init__(self, fence, pose, limits=None, *, steered=False):
        self.limits = limits or LimitsConfig()
        self.fence, self.pose = fence, pose
        self.guard = FenceGuard(
            self.limits, BODY, PERIOD_S + LATENCY_S, LIFE_S + LATENCY_S, steered=steered
        )
        self.limiter = TwistLimiter(self.limits)
        self.command = Twist(0.0, 0.0)
        self.nearest_m = self.clearance()

    def clearance(self):
        pose = np.array([(self.pose.x_m, self.pose.y_m, self.pose.theta_rad)])
        return body_clearance(self.fence, BODY, pose)[0]

    def ticks(self, seconds, target):
        for _ in range(round(seconds / TICK_S)):
            v, omega, _ = self.limiter.step(Twist(*target), TICK_S)
            self.pose @= SE2(v * TICK_S, 0.0, omega * TICK_S)
            self.nearest_m = min(self.nearest_m, self.clearance())

    def step(self, wanted):
        """Decide, and let a period pass, in which the decision comes late."""
        limiter = self.limiter
        now = MotionNow(self.pose, limiter.twist, limiter.acceleration, self.command, LATENCY_S)
        held = self.guard.hold(self.fence, now, Twist(*wanted))
        self.ticks(LATENCY_S, self.command)
        self.command = held.twist
        self.ticks(PERIOD_S - LATENCY_S, self.command)
        return held


places = st.floats(-3.0, 3.0)
points = st.tuples(places, places)
velocities = st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, 3.0))


@st.composite
def fences(draw):
    """Return a fence around what is left of a room."""
    others = tuple(
        FencePolygon(tuple(draw(st.lists(points, min_size=3, max_size=5))), draw(st.booleans()))
        for _ in range(draw(st.integers(0, 2)))
    )
    circles = (FenceCircle(*draw(points), draw(st.floats(0.1, 4.0)), draw(st.booleans())),)
    return Fence((FencePolygon(ROOM, True), *others), circles[: draw(st.integers(0, 1))])


@settings(max_examples=8)
@given(
    fences(),
    st.tuples(places, places, st.floats(-math.pi, math.pi)),
    st.lists(st.tuples(velocities, st.integers(5, 20)), min_size=1, max_size=4),
    st.sampled_from([LimitsConfig(), LimitsConfig(1.5, 3.0, 2.0, 6.0, 20.0, 60.0)]),
    st.booleans(),
)
def test_the_body_never_leaves_the_fence_whatever_is_asked_for(fence, start, wanted, limits, dies):
    robot = Driven(fence, SE2(*start), limits)
    if robot.clearance() < MARGIN_M:
        return
    for velocity, steps in wanted:
        for _ in range(steps):
            robot.step(velocity)
    if dies:  # navigation does: the last command expires
        robot.ticks(LIFE_S, robot.command)
        robot.ticks(2.0, (0.0, 0.0))
    assert robot.nearest_m > 0.5 * MARGIN_M


def test_a_robot_comes_near_the_fence_and_may_leave_it_again():
    robot = Driven(Fence((FencePolygon(ROOM, True),)), SE2(1.9, 0.0, 0.0))
    for _ in range(70):
        held = robot.step((0.5, 0.0))
    assert held.limits
    assert held.twist.v_m_s == 0.0
    assert MARGIN_M - 0.01 < robot.clearance() < 0.2
    before = robot.pose
    for _ in range(30):
        held = robot.step((-0.5, 0.0))
        assert not held.limits
    assert math.hypot(robot.pose.x_m - before.x_m, robot.pose.y_m - before.y_m) > 0.3


def test_along_the_fence_and_far_from_it_nothing_is_held_back():
    robot = Driven(Fence((FencePolygon(ROOM, True),)), SE2(-2.5, -2.0 + 0.18 + 0.07, 0.0))
    for _ in range(40):
        assert not robot.step((0.4, 0.0)).limits
    assert robot.pose.x_m > -1.9


@settings(max_examples=4)
@given(st.floats(-3.0, 3.0), st.floats(-0.5, 0.5), st.floats(-2.0, 2.0))
def test_beyond_the_fence_only_the_way_back_is_free(theta, v, omega):
    fence = Fence(circles=(FenceCircle(0.0, 0.0, 2.0, True),))
    robot = Driven(fence, SE2(4.0, 0.0, theta))
    before = robot.clearance()
    for _ in range(15):
        robot.step((v, omega))
    assert robot.clearance() >= before - 1e-4
    home = Driven(fence, SE2(2.6, 0.0, math.pi))
    for _ in range(60):
        home.step((0.5, 0.0))
    assert home.clearance() > 0.0
