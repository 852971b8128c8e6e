"""From revolutions to scans: the geometry of mounts, of a moving robot, and of the beams."""

import math

import numpy as np
import pytest

from robotctl.app.processes.lidar_scans import LidarScans
from robotctl.estimation.ranging.scan_messages import lidar_scan
from robotctl.messages.lidar_port import LidarSweep
from robotctl.model.sensors.lidar import LidarConfig
from tests.mavlink.conftest import control_state

MS = 1_000_000
WIDTH_M, DEPTH_M = 3.0, 2.0
"""Half the size of a room round the origin."""


def cast(x, y, angles):
    """Return the ranges to the walls of the room, by the plane each ray meets first."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_x = (np.sign(np.cos(angles)) * WIDTH_M - x) / np.cos(angles)
        to_y = (np.sign(np.sin(angles)) * DEPTH_M - y) / np.sin(angles)
    return np.fmin(to_x, to_y)


def sweep_of(config, pose_at, count=720, duration_ms=180, begin_ns=10_000 * MS):
    """Return a revolution, clockwise, of a lidar in the room; `pose_at` is of time in seconds."""
    stamps = begin_ns + (np.arange(count) * duration_ms * MS) // count
    clockwise = -2.0 * math.pi * np.arange(count) / count
    sign = -1.0 if config.upside_down else 1.0
    ranges = []
    for stamp, angle in zip(stamps, clockwise, strict=True):
        x, y, theta = pose_at((stamp - begin_ns) / 1e9)
        at_x = x + config.x_m * math.cos(theta) - config.y_m * math.sin(theta)
        at_y = y + config.x_m * math.sin(theta) + config.y_m * math.cos(theta)
        ray = theta + math.radians(config.yaw_deg) + sign * angle
        ranges.append(float(cast(at_x, at_y, ray)))
    return LidarSweep(stamps, clockwise, np.array(ranges))


def attend(scans, pose_at, begin_ns=10_000 * MS):
    """Tell of the odometry, 50 times a second."""
    for k in range(-5, 15):
        x, y, theta = pose_at(k * 0.02)
        scans.attend(control_state(begin_ns + k * 20 * MS, x_m=x, y_m=y, theta_rad=theta))


def still(_):
    return 0.4, -0.3, 0.5


MOUNTS = {
    "middle": {},
    "ahead": {"x_m": 0.25, "y_m": -0.1},
    "turned": {"yaw_deg": 135.0},
    "head down": {"upside_down": True, "x_m": 0.2, "yaw_deg": -90.0},
}


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize(
    "pose_at",
    [
        still,
        lambda t: (0.4 + 0.8 * t, -0.3 + 0.2 * t, 0.25),
        lambda t: (0.4, -0.3, 0.5 + 2.5 * t),
        lambda t: (0.5 * math.sin(2 * t), 0.5 - 0.5 * math.cos(2 * t), 2 * t),
    ],
    ids=["still", "straight", "on the spot", "arc"],
)
def test_all_echoes_lie_on_the_walls_as_seen_from_the_last_place(mount, pose_at):
    config = LidarConfig("rplidar", **mount)
    scans = LidarScans(config)
    sweep = sweep_of(config, pose_at)
    attend(scans, pose_at)
    scan = lidar_scan(scans.scan(sweep))
    x, y, theta = pose_at((sweep.stamps_ns[-1] - sweep.stamps_ns[0]) / 1e9)
    seen = scan.points_base()
    assert len(seen) > 300
    world_x = x + np.cos(theta) * seen[:, 0] - np.sin(theta) * seen[:, 1]
    world_y = y + np.sin(theta) * seen[:, 0] + np.cos(theta) * seen[:, 1]
    off = np.minimum(np.abs(np.abs(world_x) - WIDTH_M), np.abs(np.abs(world_y) - DEPTH_M))
    # A beam stands for half a degree to each side, which at 60 degrees and 3.5 m is 5 cm.
    assert np.median(off) < 0.012
    assert np.max(off) < 0.08
    assert scan.stamp_ns == sweep.stamps_ns[-1]


def test_without_odometry_the_samples_stay_where_they_were_measured():
    config = LidarConfig("rplidar")
    scan = lidar_scan(LidarScans(config).scan(sweep_of(config, still)))
    assert np.count_nonzero(np.isfinite(scan.ranges_m)) == 360


def test_what_was_not_measured_is_never_free():
    config = LidarConfig("rplidar", min_range_m=0.2, max_range_m=5.0)
    ranges = np.full(360, 3.0)
    ranges[:90], ranges[90:180], ranges[180:270] = np.nan, 0.1, 7.0
    stamps = np.arange(360, dtype=np.int64)
    sweep = LidarSweep(stamps, np.radians(np.arange(360) + 0.3) - math.pi, ranges)
    message = LidarScans(config).scan(sweep)
    found = lidar_scan(message).ranges_m
    assert np.count_nonzero(np.isnan(found)) == pytest.approx(180, abs=2)
    assert np.count_nonzero(np.isinf(found)) == pytest.approx(90, abs=2)


def test_sectors_in_which_the_robot_sees_itself_are_hidden():
    config = LidarConfig("rplidar", hidden_deg=((170.0, -170.0), (80.0, 100.0)))
    sweep = sweep_of(config, lambda _: (0.1, 0.2, 0.01))
    scan = lidar_scan(LidarScans(config).scan(sweep))
    hidden = np.degrees(scan.angles_rad[np.isnan(scan.ranges_m)])
    assert np.all((np.abs(hidden) >= 169.0) | ((hidden >= 79.0) & (hidden <= 101.0)))
    assert len(hidden) == pytest.approx(42, abs=2)
