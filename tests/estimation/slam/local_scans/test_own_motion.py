"""Sweeps without odometry, in a drawn building: what the scans themselves show takes them apart."""

import math

import numpy as np
import pytest

from robotctl.estimation.slam.local_scans.own_motion import OwnMotion
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import scan_of

SWEEP_S = 0.1
ANGLES = np.radians(np.arange(-180.0, 180.0, 2.0))


def pose_at(t):
    """Return a robot that weaves along a corridor and at the end turns on the spot."""
    return SE2(1.0 + 0.4 * t, 1.0, 0.5 * math.sin(2.0 * t)) if t < 4.0 else SE2(
        2.6, 1.0, 0.5 * math.sin(8.0) + 1.0 * (t - 4.0)
    )  # fmt: skip


def swept(end_s, rng):
    """Return a sweep that ends at a time, each beam from its own place."""
    ages_s = np.linspace(SWEEP_S, 0.0, len(ANGLES))
    ranges = [
        scan_of(OFFICE, pose_at(end_s - age_s), rng, angles=ANGLES[[k]]).ranges_m[0]
        for k, age_s in enumerate(ages_s)
    ]
    return RangeScan(round(1e9 * end_s), ANGLES, np.array(ranges), 12.0, sweep_s=SWEEP_S)


def off_walls(scan, pose):
    """Return the distances of the echoes from the walls as seen from a pose [m]."""
    points = np.array([pose.apply(*point) for point in scan.points_base()])
    a, e = OFFICE[:, 0], OFFICE[:, 1] - OFFICE[:, 0]
    d = points[:, None] - a
    share = np.clip((d * e).sum(axis=2) / (e**2).sum(axis=1), 0.0, 1.0)
    return np.hypot(*np.moveaxis(d - share[..., None] * e, 2, 0)).min(axis=1)


def test_the_shear_of_a_turning_robot_goes():
    rng, motion = np.random.default_rng(1), OwnMotion()
    as_is, straight = [], []
    for end_s in np.arange(0.2, 6.0, 0.1).tolist():
        scan = swept(end_s, rng)
        unwound = motion.straight(scan)
        assert unwound.stamp_ns == scan.stamp_ns
        as_is.append(off_walls(scan, pose_at(end_s)))
        straight.append(off_walls(unwound, pose_at(end_s)))
    as_is, straight = np.concatenate(as_is), np.concatenate(straight)
    assert np.sqrt(np.mean(as_is**2)) > 0.07
    assert np.sqrt(np.mean(straight**2)) < 0.4 * np.sqrt(np.mean(as_is**2))
    assert np.median(straight) < 0.015


def test_a_scan_of_one_instant_stays_the_same_object():
    scan = scan_of(OFFICE, SE2(1.0, 1.0, 0.0), np.random.default_rng(1), angles=ANGLES)
    assert OwnMotion().straight(scan) is scan


def test_a_scan_long_after_the_last_stays_as_it_was_measured():
    rng, motion = np.random.default_rng(1), OwnMotion()
    motion.straight(swept(4.5, rng))
    motion.straight(swept(4.6, rng))
    late = swept(5.5, rng)
    assert motion.straight(late).points_base() == pytest.approx(late.points_base(), abs=1e-9)
