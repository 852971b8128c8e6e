"""Cylinders found in scans whose ranges are computed circle by circle."""

import math

import numpy as np
import pytest

from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.cylinders import CylinderConfig, cylinders
from robotctl.estimation.landmarks.localisation import localise_by_landmarks
from robotctl.model.recording import UNKNOWN_LANDMARK, Recording, Sighting
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.trajectory import Trajectory
from tests.estimation.landmarks.landmark_drives import start_near

ROUND = CylinderConfig(diameter_m=0.08, behind_m=0.04 * math.pi / 4.0)


def scan_of(circles, wall_m=2.5, noise=None, x_m=0.0):
    """The nearest of a round wall and circles (x, y, radius), by the quadratic of each."""
    angles = np.linspace(-2.0, 2.0, 660)
    ranges = np.full(660, wall_m)
    for x, y, radius in circles:
        along = (x - x_m) * np.cos(angles) + y * np.sin(angles)
        root = along**2 - (x - x_m) ** 2 - y**2 + radius**2
        hit = (root >= 0.0) & (along > 0.0)
        near = along - np.sqrt(np.where(hit, root, 0.0))
        ranges = np.where(hit & (near < ranges), near, ranges)
    if noise is not None:
        ranges = ranges + noise.normal(0.0, 0.004, 660)
    return RangeScan(0, angles, ranges, 4.0, x_m)


def test_range_and_bearing_are_those_of_the_axes():
    circles = [(1.0, 0.0, 0.04), (0.5, 0.8, 0.04), (0.2, -0.6, 0.04)]
    found = cylinders(scan_of(circles, noise=np.random.default_rng(1)), ROUND)
    expected = sorted((math.atan2(y, x), math.hypot(x, y)) for x, y, _ in circles)
    assert found[:, 1] == pytest.approx([bearing for bearing, _ in expected], abs=0.01)
    assert found[:, 0] == pytest.approx([range_m for _, range_m in expected], abs=0.01)


def test_a_lidar_ahead_of_base_sees_the_same_places():
    found = cylinders(scan_of([(0.5, 0.8, 0.04)], x_m=0.2), ROUND)
    assert found[0] == pytest.approx([math.hypot(0.5, 0.8), math.atan2(0.8, 0.5)], abs=0.01)


@pytest.mark.parametrize("radius", [0.005, 0.15])
def test_what_is_much_thinner_or_wider_is_none(radius):
    assert len(cylinders(scan_of([(1.0, 0.0, radius)]), ROUND)) == 0


def test_what_stands_at_a_wall_or_at_the_edge_of_the_view_is_none():
    at_the_wall, at_the_edge = (2.45, 0.0, 0.04), (math.cos(2.0), math.sin(2.0), 0.04)
    assert len(cylinders(scan_of([at_the_wall]), ROUND)) == 0
    assert len(cylinders(scan_of([at_the_edge]), ROUND)) == 0


def test_a_hole_in_a_wall_is_none():
    scan = scan_of([])
    ranges = scan.ranges_m.copy()
    ranges[300:312] = 3.5
    hole = RangeScan(0, scan.angles_rad, ranges, 4.0)
    assert len(cylinders(hole, ROUND)) == 0


def test_beams_without_a_reading_do_not_hide_a_cylinder():
    scan = scan_of([(1.0, 0.0, 0.04)])
    ranges = scan.ranges_m.copy()
    ranges[[10, 329, 331]] = math.nan
    ranges[500:] = math.inf
    found = cylinders(RangeScan(0, scan.angles_rad, ranges, 4.0), ROUND)
    assert found == pytest.approx(np.array([[1.0, 0.0]]), abs=0.01)


def test_a_scan_without_any_reading_has_none():
    empty = RangeScan(0, np.zeros(3), np.full(3, math.nan), 4.0)
    assert cylinders(empty, ROUND).shape == (0, 2)


@pytest.mark.parametrize(
    "change", [{"behind_m": -0.1}, {"beams": 0}, {"diameter_m": 0.0}, {"greatest_width": 0.5}]
)
def test_settings_out_of_their_range_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        CylinderConfig(**change)


PLACES = {
    0: (2.0, 0.3),
    1: (0.9, 2.1),
    2: (-0.8, 2.6),
    3: (-1.7, 0.4),
    4: (1.4, -1.1),
    5: (-0.6, -1.0),
}


def circled(named, strangers=0):
    """A circle of 1 m to the left among six places, seen at 4 Hz in front."""
    rng = np.random.default_rng(3)
    times_ns = 50_000_000 * np.arange(1200)
    theta = 0.3e-9 * times_ns
    poses = np.stack([np.sin(theta), 1.0 - np.cos(theta), theta], axis=1)
    seen = []
    for i in range(0, 1195, 5):
        for name, (px, py) in PLACES.items():
            dx, dy = px - poses[i, 0], py - poses[i, 1]
            bearing = math.remainder(math.atan2(dy, dx) - theta[i], math.tau)
            if abs(bearing) < 1.9:
                off_m, off_rad = rng.normal(0.0, (0.02, 0.005)).tolist()
                label = name if named else UNKNOWN_LANDMARK
                range_m = math.hypot(dx, dy) + off_m
                seen.append(Sighting(int(times_ns[i]), label, range_m, bearing + off_rad))
        if i < 5 * strangers:
            seen.append(Sighting(int(times_ns[i]), UNKNOWN_LANDMARK, 6.0, 0.1))
    return Recording(
        "circle",
        twist_stamps_ns=times_ns,
        twists=np.tile([0.3, 0.3], (1200, 1)),
        reference=Trajectory(times_ns, poses),
        sightings=tuple(seen),
        landmarks=PLACES,
    )


@pytest.mark.parametrize("named", [True, False])
def test_landmarks_without_a_name_are_the_nearest_ones_and_strangers_are_passed_over(named):
    drive = circled(named, strangers=40)
    start = start_near(drive, 1)
    steps = list(localise_by_landmarks(drive, LandmarkConfig(), start))
    end, truth = steps[-1].estimate.pose, drive.reference.poses[-1]
    assert (end.x_m, end.y_m) == pytest.approx(tuple(truth[:2]), abs=0.06)
    taken = sum(len(step.innovations) for step in steps)
    real = len(drive.sightings) - 40
    assert 0.95 * real <= taken <= real
