"""Points moved at once, and laid upon others."""

import math

import numpy as np
import pytest

from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-3.0, 3.0, (20, 2))


def test_points_are_moved_as_each_alone():
    pose = SE2(4.0, -1.0, 2.0)
    there = [pose.apply(x, y) for x, y in POINTS.tolist()]
    assert moved(pose, POINTS) == pytest.approx(np.array(there))


def test_alignment_takes_away_turn_and_shift_and_nothing_else():
    pose = SE2(4.0, -1.0, 2.0)
    wanted = moved(pose, POINTS)
    found = align(POINTS, wanted)
    assert (found.x_m, found.y_m) == pytest.approx((4.0, -1.0))
    assert math.cos(found.theta_rad - 2.0) == pytest.approx(1.0)
    off = moved(align(1.1 * POINTS, wanted), 1.1 * POINTS) - wanted
    spread = np.sum((POINTS - POINTS.mean(axis=0)) ** 2)
    assert np.sum(off**2) == pytest.approx(0.01 * spread)
