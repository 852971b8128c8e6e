"""Poses that drift are told from right ones where a robot comes by again."""

import math

import numpy as np
import pytest

from robotctl.estimation.grid.revisits import revisit_agreement
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from tests.workbench.localise.recorded_room import driven, seen

ANGLES = np.radians(np.arange(181) - 90.0)


def drive(steps=300):
    """Scans of a room that the robot goes round and round, its poses, and a drifting odometry."""
    truth, odometry = driven(steps)
    rng = np.random.default_rng(5)
    scans = []
    for pose in truth:
        ranges = seen(*pose)
        ranges = np.where(ranges < 80.0, ranges + 0.02 * rng.standard_normal(181), math.inf)
        scans.append(RangeScan(0, ANGLES, ranges, 30.0))
    return scans, [SE2(*pose) for pose in truth], [SE2(*pose) for pose in odometry]


def test_scans_agree_at_right_poses_and_not_at_those_of_odometry():
    scans, truth, odometry = drive()
    assert revisit_agreement(scans, truth) > 0.8
    assert revisit_agreement(scans, odometry) < 0.3


def test_it_does_not_matter_where_the_world_begins():
    scans, truth, _ = drive()
    moved = [SE2(100.0, -50.0, 2.0) @ pose for pose in truth]
    assert revisit_agreement(scans, moved) == pytest.approx(
        revisit_agreement(scans, truth), abs=0.02
    )


def test_who_never_comes_by_again_shows_nothing():
    scans, truth, _ = drive(40)
    assert revisit_agreement(scans, truth) is None
    assert revisit_agreement([], []) is None
