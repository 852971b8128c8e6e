"""The filter behind calibration, against a dense covariance of all references at once."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from robotctl.estimation.odometry.innovations import whitened_innovations
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, propagate
from robotctl.model.geometry.se2 import SE2

NOISE = MotionNoise(0.01, 0.02, 0.03)
GROWTH = np.square([0.01, 0.02, 0.03])
STAMPS = np.linspace(0.0, 10.0, 101)
ARCS = np.tile([0.03, 0.004, 0.0], (100, 1))
START = np.array([1.0, -2.0, 0.4])
START_VARIANCE = np.array([0.001, 0.002, 0.003])
VARIANCE = np.array([4e-4, 9e-4, 0.01])
SPEED_M_S = 0.3


def pose_after(k):
    """Dead reckoning after so many steps."""
    pose = SE2(*START)
    for d, a, _ in ARCS[:k]:
        pose = arc(pose, d, a)
    return pose


def innovations(reference, reference_s, lever=(0.0, 0.0), delay=0.0, outlier=0.0):
    speed = np.full(len(reference_s), SPEED_M_S)
    return whitened_innovations(
        STAMPS, ARCS, START, START_VARIANCE, GROWTH, np.asarray(reference_s), reference, speed,
        VARIANCE, np.asarray(lever), delay, outlier,
    )  # fmt: skip


def dense(steps, lever, headings):
    """Mean and covariance of references after given steps, linearised along dead reckoning."""
    mean, poses, rows, noise_of = [], [], [], []
    for k in steps:
        pose = pose_after(k)
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        x, y = c * lever[0] - s * lever[1], s * lever[0] + c * lever[1]
        H = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])[: 3 if headings else 2]
        mean.append(np.array([pose.x_m + x, pose.y_m + y, pose.theta_rad])[: len(H)])
        poses.append(pose)
        rows.append(H)
        u = np.array([c, s, 0.0])
        R = np.diag(VARIANCE[[0, 0, 1]]) + VARIANCE[2] * SPEED_M_S**2 * np.outer(u, u)
        noise_of.append(R[: len(H), : len(H)])
    P = [propagate_to(k) for k in steps]
    blocks = []
    for i in range(len(steps)):
        row = []
        for j in range(len(steps)):
            early, late = (i, j) if i <= j else (j, i)
            # cov(x_late, x_early) = F(early -> late) P_early
            F = np.eye(3)
            a, b = poses[early], poses[late]
            F[0, 2], F[1, 2] = -(b.y_m - a.y_m), b.x_m - a.x_m
            cross = F @ P[early]
            block = rows[late] @ cross @ rows[early].T
            block = block if i >= j else block.T
            row.append(block + (noise_of[i] if i == j else 0.0))
        blocks.append(row)
    return np.concatenate(mean), np.block(blocks)


def propagate_to(k):
    P, pose = np.diag(START_VARIANCE), SE2(*START)
    for d, a, _ in ARCS[:k]:
        P = propagate(P, pose, d, a, NOISE)
        pose = arc(pose, d, a)
    return P


@pytest.mark.parametrize("headings", [True, False])
@pytest.mark.parametrize("lever", [(0.0, 0.0), (0.05, -0.03)])
def test_they_are_as_likely_as_all_references_are_together(headings, lever):
    steps = [10, 35, 60, 100]
    mean, covariance = dense(steps, lever, headings)
    rng = np.random.default_rng(3)
    # so small that nothing bends: the filter linearises about what it believes
    errors = 1e-4 * rng.standard_normal(len(mean))
    n = 3 if headings else 2
    reference = np.full((len(steps), 3), math.nan)
    reference[:, :n] = (mean + errors).reshape(-1, n)
    out, log_det = innovations(reference, STAMPS[steps], lever)
    expected = multivariate_normal(np.zeros(len(mean)), covariance)
    found = -0.5 * (np.sum(out**2) + log_det + len(mean) * math.log(math.tau))
    assert found == pytest.approx(expected.logpdf(errors), rel=1e-4)
    assert np.sum(out**2) == pytest.approx(errors @ np.linalg.solve(covariance, errors), rel=1e-3)
    if not headings:
        assert np.all(out[:, 2] == 0.0)


def test_a_reference_between_two_stamps_meets_the_robot_on_its_arc():
    half = arc(pose_after(20), 0.015, 0.002)
    reference = np.array([[half.x_m, half.y_m, half.theta_rad]])
    out, _ = innovations(reference, [0.5 * (STAMPS[20] + STAMPS[21])])
    np.testing.assert_allclose(out, 0.0, atol=1e-9)


def test_a_late_reference_meets_the_robot_where_it_was():
    then = pose_after(30)
    reference = np.array([[then.x_m, then.y_m, then.theta_rad + math.tau]])
    out, _ = innovations(reference, [STAMPS[32]], delay=STAMPS[2])
    np.testing.assert_allclose(out, 0.0, atol=1e-9)


def test_an_outlier_moves_the_belief_less_than_its_size_asks():
    """Two references: after a wild first one, the second is believed to be near dead reckoning."""
    at, end = pose_after(50), pose_after(100)
    wild = [at.x_m + 5.0, at.y_m, math.nan]
    reference = np.array([wild, [end.x_m, end.y_m, math.nan]])
    trusting, _ = innovations(reference, STAMPS[[50, 100]])
    careful, _ = innovations(reference, STAMPS[[50, 100]], outlier=3.0)
    np.testing.assert_allclose(trusting[0], careful[0])
    assert np.linalg.norm(careful[1]) < 0.2 * np.linalg.norm(trusting[1])
