"""Remembered measurements say of a pose now what each said of where the robot then was."""

import math

import numpy as np
import pytest

from robotctl.estimation.mcl.remembered import Remembered
from robotctl.model.geometry.se2 import SE2


def gaussian(pose: SE2):
    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        off = poses - (pose.x_m, pose.y_m, pose.theta_rad)
        off[:, 2] -= math.tau * np.round(off[:, 2] / math.tau)
        return -np.sum(off**2, axis=1)

    return log_likelihood


def test_the_sum_is_that_of_all_places_on_the_way():
    rng = np.random.default_rng(1)
    remembered, pose = Remembered(), SE2(1.0, 2.0, 0.5)
    for _ in range(30):
        motion = SE2(*rng.normal(size=3))
        pose = pose @ motion
        remembered.move(motion)
        remembered.add(gaussian(pose))
    here = np.array([[pose.x_m, pose.y_m, pose.theta_rad]])
    assert len(remembered) == 16
    assert remembered(here)[0] == pytest.approx(0.0, abs=1e-9)
    assert remembered.newest(here)[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(remembered(here + rng.normal(size=(50, 3))) < 0.0)


def test_a_shift_of_a_way_without_turns_counts_at_each_measurement():
    remembered, pose = Remembered(), SE2(3.0, 1.0, 0.0)
    for _ in range(4):
        remembered.move(SE2(0.5, 0.0, 0.0))
        pose = pose @ SE2(0.5, 0.0, 0.0)
        remembered.add(gaussian(pose))
    assert remembered(np.array([[pose.x_m, pose.y_m + 0.2, 0.0]]))[0] == pytest.approx(-4 * 0.04)
    remembered.clear()
    assert remembered(np.zeros((3, 3))).tolist() == [0.0, 0.0, 0.0]
