"""A step aside: it begins and ends as it should, and bends no more than the robot can."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.journey.sidestep import sidestep

RADIUS_M = 0.5


@given(
    there=st.builds(SE2, st.floats(-3, 3), st.floats(-3, 3), st.floats(-math.pi, math.pi)),
    along=st.floats(0.8, 3.0),
    aside=st.floats(-0.4, 0.4),
    turned=st.floats(-0.2, 0.2),
    reverse=st.booleans(),
    length=st.floats(0.7, 3.0),
)
def test_it_leads_from_one_pose_to_the_other_in_one_gear(
    there, along, aside, turned, reverse, length
):
    pose = there @ SE2(along if reverse else -along, aside, turned)
    plan = sidestep(pose, there, RADIUS_M, length)
    assume(plan is not None)
    begin, end = plan.poses[0], plan.poses[-1]
    assert math.dist(begin[:2], (pose.x_m, pose.y_m)) < 1e-9
    assert abs(wrap_angle(begin[2] - pose.theta_rad)) < 0.1  # what is left of it is noise
    assert math.dist(end[:2], (there.x_m, there.y_m)) < 1e-9
    assert abs(wrap_angle(end[2] - there.theta_rad)) < 1e-9
    assert (plan.reverse == reverse).all()
    steps = np.diff(plan.poses, axis=0)
    ways_m, turns = np.hypot(*steps[:, :2].T), np.abs(steps[:, 2])
    assert (turns <= ways_m / RADIUS_M + 2e-3).all()
    driven = np.arctan2(steps[:, 1], steps[:, 0]) + math.pi * reverse
    middle = 0.5 * (plan.poses[1:, 2] + plan.poses[:-1, 2])
    off = np.angle(np.exp(1j * (driven - middle)))
    assert (np.abs(off) <= 0.5 * ways_m / RADIUS_M).all()  # as a chord may: wheels do not slide


@pytest.mark.parametrize(
    "begin",
    [
        SE2(-0.5, 0.4, 0.0),  # too near for its circle
        SE2(-2.0, 0.3, 0.8),  # looks elsewhere
        SE2(-2.0, 0.3, math.pi),
        SE2(0.0, 0.3, 0.0),  # straight beside
    ],
)
def test_there_is_none_that_the_robot_could_not_drive(begin):
    assert sidestep(begin, SE2(), RADIUS_M, 2.0) is None
