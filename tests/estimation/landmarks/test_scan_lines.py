"""Walls and corners in scans of rooms that are known, with gaps, and in a real lidar log."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.landmarks.line_fitting import BeamNoise
from robotctl.estimation.landmarks.scan_lines import ScanLinesConfig, find_lines
from robotctl.estimation.ranging.sonar_cones import SonarCones
from robotctl.estimation.ranging.wall_echoes import WallEchoes
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.wall_map import WallMap

NOISE = BeamNoise(0.01, 0.0, 1e-6)
CONFIG = ScanLinesConfig(noise=NOISE)
ROOM = np.array([[0, 0, 5, 0], [5, 0, 5, 4], [5, 4, 0, 4], [0, 4, 0, 0]], dtype=np.float64)
CORNERS = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 4.0], [0.0, 4.0]])


def scan_of(walls, pose=(2.0, 1.5, 0.4), beams=360, fov=math.tau, sigma_m=0.01, seed=1):
    """A scan of walls with noise of the ranges, by rays that are cast elsewhere."""
    angles = np.linspace(-0.5 * fov, 0.5 * fov, beams, endpoint=fov < math.tau)
    mounts = np.stack([np.zeros(beams), np.zeros(beams), angles], axis=1)
    rays = WallEchoes(WallMap(walls), SonarCones(mounts, 1e-6, math.radians(89.9), 30.0))
    ranges = rays.ranges(np.array([pose]), np.arange(beams))[0]
    rng = np.random.default_rng(seed)
    return RangeScan(0, angles, ranges + sigma_m * rng.standard_normal(beams), 20.0)


def in_base(point, pose=(2.0, 1.5, 0.4)):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = point[0] - pose[0], point[1] - pose[1]
    return np.array([c * x + s * y, c * y - s * x])


@pytest.mark.parametrize("seed", range(5))
def test_a_room_has_four_walls_and_four_corners_wherever_the_scan_begins(seed):
    pose = (1.0 + 0.6 * seed, 1.0 + 0.4 * seed, 1.3 * seed)
    found = find_lines(scan_of(ROOM, pose, seed=seed), CONFIG)
    lengths = sorted(each.length_m for each in found.segments)
    np.testing.assert_allclose(lengths, [4.0, 4.0, 5.0, 5.0], atol=0.5)
    assert len(found.corners) == 4
    for corner in CORNERS:
        seen = in_base(corner, pose)
        assert min(np.hypot(*(each.position - seen)) for each in found.corners) < 0.02


def test_walls_and_corners_err_as_much_as_they_say():
    lines, corners = [], []
    for seed in range(40):
        found = find_lines(scan_of(ROOM, seed=seed), CONFIG)
        for segment in found.segments:
            alpha = round((segment.line.alpha_rad + 0.4) / (math.pi / 2)) * math.pi / 2 - 0.4
            normal = np.array([math.cos(alpha), math.sin(alpha)])
            r_m = max(float(normal @ in_base(corner)) for corner in CORNERS)
            error = np.array([wrap_angle(segment.line.alpha_rad - alpha), segment.line.r_m - r_m])
            lines.append(error @ np.linalg.solve(segment.line.covariance, error))
        for corner in found.corners:
            off = [corner.position - in_base(each) for each in CORNERS]
            error = min(off, key=lambda each: float(np.hypot(*each)))
            corners.append(error @ np.linalg.solve(corner.covariance, error))
    assert len(lines) == len(corners) == 160
    for values in (lines, corners):
        low, high = chi2_bounds(160 * 2, 0.9999)
        assert low < sum(values) < high


def test_missing_beams_leave_a_wall_whole_and_a_door_cuts_it():
    scan = scan_of(ROOM, fov=math.pi, beams=180)
    ranges = scan.ranges_m.copy()
    ranges[::7], ranges[3::11] = np.inf, np.nan
    whole = find_lines(replace(scan, ranges_m=ranges), CONFIG)
    assert len(whole.segments) == len(find_lines(scan, CONFIG).segments)
    for segment in whole.segments:
        assert np.all(np.isfinite(ranges[segment.beams]))
    door = np.array([[3, -2, 3, -0.5], [3, 0.5, 3, 2]], dtype=np.float64)
    found = find_lines(scan_of(door, (0.0, 0.0, 0.0), fov=2.0, beams=200), CONFIG)
    assert len(found.segments) == 2
    assert not found.corners
    np.testing.assert_allclose(
        sorted(abs(end[1]) for segment in found.segments for end in segment.ends),
        [0.5, 0.5, 2.0, 2.0],
        atol=0.05,
    )


def test_steps_between_parallel_walls_are_no_corners():
    steps = np.array([[2, -2, 2, 0], [2.6, 0, 2.6, 2]], dtype=np.float64)
    found = find_lines(scan_of(steps, (0.0, 0.0, 0.0), fov=2.0, beams=200), CONFIG)
    assert [round(segment.line.r_m, 1) for segment in found.segments] == [2.0, 2.6]
    assert not found.corners


def test_where_the_sensor_sits_is_counted():
    scan = scan_of(ROOM)
    moved = find_lines(replace(scan, x_m=0.3, y_m=-0.1), CONFIG)
    assert len(moved.segments) >= 4
    for before, after in zip(find_lines(scan, CONFIG).segments, moved.segments, strict=True):
        shift = float(before.line.normal @ [0.3, -0.1])
        assert after.line.r_m == pytest.approx(before.line.r_m + shift, abs=1e-9)
        assert after.line.alpha_rad == pytest.approx(before.line.alpha_rad, abs=1e-9)


@settings(max_examples=15)
@given(st.floats(-3.0, 3.0))
def test_a_turned_robot_sees_the_same_room_turned(turn):
    scan = scan_of(ROOM, fov=4.0, beams=200)
    there = find_lines(replace(scan, angles_rad=scan.angles_rad + turn), CONFIG)
    assert len(there.segments) >= 3
    for before, after in zip(find_lines(scan, CONFIG).segments, there.segments, strict=True):
        assert wrap_angle(after.line.alpha_rad - before.line.alpha_rad - turn) == pytest.approx(
            0.0, abs=1e-9
        )
        assert after.line.r_m == pytest.approx(before.line.r_m, abs=1e-9)
        assert after.beams.tolist() == before.beams.tolist()


@pytest.mark.parametrize("value", [math.inf, math.nan, 1.0])
def test_what_shows_no_wall_gives_none(value):
    scan = RangeScan(0, np.linspace(-1.0, 1.0, 50), np.full(50, value), 10.0)
    found = find_lines(scan, CONFIG)
    # Ranges of 1 m all round are a circle about the sensor, which is not straight.
    for segment in found.segments:
        assert segment.length_m < 0.6
    assert not found.segments or value == 1.0
    assert find_lines(RangeScan(0, np.empty(0), np.empty(0), 10.0)).segments == ()


def test_beams_out_of_order_are_refused():
    scan = RangeScan(0, np.array([0.0, 0.2, 0.1]), np.ones(3), 10.0)
    with pytest.raises(ValueError, match="angles_rad"):
        find_lines(scan)


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"sigmas": 0.0}, "sigmas"),
        ({"grazing_deg": 90.0}, "grazing_deg"),
        ({"corner_deg": 0.0}, "corner_deg"),
        ({"least_points": 2}, "least_points"),
        ({"least_length_m": -1.0}, "least_length_m"),
        ({"corner_gap_m": math.inf}, "corner_gap_m"),
    ],
)
def test_a_setting_out_of_its_range_is_refused(keys, word):
    with pytest.raises(ValueError, match=word):
        ScanLinesConfig(**keys)


@pytest.mark.recordings("carmen/intel-odometry.log.gz")
def test_in_a_real_building_the_walls_lie_on_their_points_and_at_right_angles(recordings):
    scans = read_recording(recordings / "carmen" / "intel-odometry.log.gz").scans[::20]
    walls, off, corners, squared, dof = 0, [], 0, 0.0, 0
    directions = []
    for entry in scans:
        found = find_lines(entry.scan)
        corners += len(found.corners)
        for segment in found.segments:
            walls += 1
            at = replace(
                entry.scan,
                angles_rad=entry.scan.angles_rad[segment.beams],
                ranges_m=entry.scan.ranges_m[segment.beams],
            ).points_base()
            off.append(segment.line.distances_m(at))
            squared += segment.line.chi2
            dof += segment.line.points - 2
            if segment.length_m > 1.5:
                directions.append(segment.line.alpha_rad + entry.reference.theta_rad)
    away = np.abs(np.concatenate(off))
    assert walls > 3 * len(scans)
    assert corners > 0.3 * len(scans)
    assert np.sqrt(np.mean(away**2)) < 0.03
    assert away.max() < 0.2
    # No worse than the noise that was assumed.
    assert squared / dof < 1.0
    # The building has right angles: four times the direction is one direction.
    fourfold = np.exp(4j * np.array(directions))
    assert abs(fourfold.mean()) > 0.6
