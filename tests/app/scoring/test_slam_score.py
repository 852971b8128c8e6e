"""Score of SLAM: trajectories and loops that are wrong by known amounts."""

import math

import numpy as np
import pytest

from robotctl.app.scoring.score import StampedPose
from robotctl.app.scoring.slam_score import SlamScore
from robotctl.messages.estimation import ClosedLoop
from robotctl.model.geometry.se2 import SE2

STEP_NS = 50_000_000


def circle(count=400, radius_m=3.0):
    """Return poses along a circle, a lap in all, from the origin."""
    angles = np.arange(count) * 2.0 * math.pi / count
    return [SE2(radius_m * math.sin(a), radius_m * (1.0 - math.cos(a)), a) for a in angles]


def driven(true, believed):
    score = SlamScore()
    for row, (truth, guess) in enumerate(zip(true, believed, strict=True)):
        score.truth(StampedPose(row * STEP_NS, truth.x_m, truth.y_m, truth.theta_rad))
        score.estimate(guess, truth)
    return score


def test_a_turned_trajectory_has_no_error_of_its_own():
    true = circle()
    turned = SE2(4.0, -1.0, 0.6)
    result = driven(true, [turned @ each for each in true]).result()
    assert result.ape_m == pytest.approx(0.0, abs=1e-9)
    assert result.rpe_m == pytest.approx(0.0, abs=1e-9)


def test_odometry_that_is_too_long_by_a_tenth_is_so_on_each_metre():
    # Straight on for 20 m: 0.1 m a metre too long, and the rest after the best shift.
    true = [SE2(0.1 * row, 0.0, 0.0) for row in range(201)]
    result = driven(true, [SE2(1.1 * each.x_m, 0.0, 0.0) for each in true]).result()
    assert 0.1 <= result.rpe_m + 1e-9 <= 0.11 + 2e-9  # a metre, or the next pose behind it
    assert result.rpe_rad == pytest.approx(0.0, abs=1e-9)
    # A uniform error from -1 to 1 m.
    assert result.ape_m == pytest.approx(2.0 / math.sqrt(12.0), rel=0.02)


def test_loops_are_judged_by_where_the_robot_was_then_also_when_that_comes_later():
    true = circle()
    score = SlamScore()
    at = [row * STEP_NS for row in range(len(true))]

    def loop(later, earlier, shift_m=0.0, turn_rad=0.0):
        pose = true[earlier].inverse() @ true[later] @ SE2(shift_m, 0.0, turn_rad)
        return ClosedLoop(at[later], at[earlier], pose.x_m, pose.y_m, pose.theta_rad)

    score.hear([loop(390, 5, 0.4)], "good")
    for stamp_ns, pose in zip(at, true, strict=True):
        score.truth(StampedPose(stamp_ns, pose.x_m, pose.y_m, pose.theta_rad))
        score.estimate(pose, pose)
    assert (score.result().loops, score.result().false_loops) == (1, 0)
    score.hear([loop(390, 5, 0.6), loop(380, 2, 0.0, -0.25), loop(380, 2, 0.1, 0.1)], "good")
    score.hear([ClosedLoop(at[9], -7, 0.0, 0.0, 0.0)], "good")  # of a run before this one
    assert (score.result().loops, score.result().false_loops) == (4, 2)


def test_without_a_drive_there_is_no_score():
    assert SlamScore().result() is None
