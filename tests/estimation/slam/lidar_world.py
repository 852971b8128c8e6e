"""Walls as segments, and the scans that a lidar takes between them."""

from __future__ import annotations

import itertools

import numpy as np

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

HALF_CIRCLE = np.radians(np.arange(-90.0, 90.0))


def box(x, y, width, height):
    """Return the four sides of a box, (4, 2, 2)."""
    corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def scan_of(walls, pose, rng, *, sigma_m=0.01, reach_m=12.0, stamp_ns=0, angles=HALF_CIRCLE):
    """Return the scan taken at a pose among walls (n, 2, 2)."""
    directions = pose.theta_rad + angles
    d = np.stack([np.cos(directions), np.sin(directions)], axis=1)[:, None]
    a = walls[None, :, 0] - np.array([pose.x_m, pose.y_m])
    e = walls[None, :, 1] - walls[None, :, 0]
    cross = d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[..., 0] * e[..., 1] - a[..., 1] * e[..., 0]) / cross
        u = (a[..., 0] * d[..., 1] - a[..., 1] * d[..., 0]) / cross
    t[~((t > 0.0) & (u >= 0.0) & (u <= 1.0))] = np.inf
    ranges = t.min(axis=1)
    ranges = np.where(ranges < reach_m, ranges + sigma_m * rng.standard_normal(len(angles)), np.inf)
    return RangeScan(stamp_ns, angles, ranges, reach_m)


def along(corners, step_m=0.3, turn_rad=0.25):
    """Return poses along a path of straight pieces, turning on the spot at its corners."""
    poses = []
    heading = None
    for (x, y), (to_x, to_y) in itertools.pairwise(corners):
        ahead = np.arctan2(to_y - y, to_x - x)
        if heading is not None:
            turn = (ahead - heading + np.pi) % (2.0 * np.pi) - np.pi
            count = int(np.ceil(abs(turn) / turn_rad))
            poses += [SE2(x, y, heading + turn * k / count) for k in range(1, count)]
        heading = ahead
        count = int(np.ceil(np.hypot(to_x - x, to_y - y) / step_m))
        poses += [
            SE2(x + (to_x - x) * k / count, y + (to_y - y) * k / count, ahead) for k in range(count)
        ]
    return poses


def drifting(poses, rng, noise=0.03, bias_rad=0.01):
    """Return odometry of a drive: noise on each motion, and a turn of its own each metre."""
    odometry = [SE2()]
    for before, now in itertools.pairwise(poses):
        step = before.inverse() @ now
        length = np.hypot(step.x_m, step.y_m)
        e = noise * rng.standard_normal(2)
        odometry.append(
            odometry[-1]
            @ SE2(
                step.x_m * (1.0 + e[0]),
                step.y_m,
                step.theta_rad * (1.0 + e[1]) + bias_rad * length,
            )
        )
    return odometry
