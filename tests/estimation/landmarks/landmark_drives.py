"""Drives among landmarks, simulated with an odometry and a camera that are off."""

from __future__ import annotations

import math

import numpy as np

from robotctl.model.drives.motion import arc
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording, Sighting
from robotctl.model.trajectory import Trajectory

LANDMARKS = {
    10 + i: (3.0 * math.cos(i * math.tau / 8), 3.0 * math.sin(i * math.tau / 8)) for i in range(8)
}
TICK_S = 0.05
START_SIGMA = np.array([0.1, 0.1, 0.1])


def simulated_drive(
    seed,
    seconds=200.0,
    depth=1.0,
    range_sigma=0.02,
    delay_s=0.15,
    distance_scale=0.05,
    turn_scale=-0.08,
    axis=0.015,
    range_scale=0.03,
    carried=None,
    outliers=0.0,
    motion_noise=1.0,
):
    """A robot in a ring of landmarks, seen within half a radian at 2 Hz; see `Recording`.

    What odometry tells at a time the robot does `delay_s` later. `carried`: (time [s], pose).
    """
    rng = np.random.default_rng(seed)
    n = round(seconds / TICK_S)
    late = round(delay_s / TICK_S)
    times_ns = np.arange(n + 1) * round(TICK_S * 1e9)
    told = np.zeros((n + 1, 2))
    poses, sightings = [SE2()], []
    for k in range(n):
        told[k] = told[k - 1]
        if k % 50 == 0:  # every 2.5 s the way to the next place; in between nobody steers
            goal = rng.uniform(-1.8, 1.8, 2).tolist()
            gx, gy = poses[-1].inverse().apply(*goal)
            told[k] = 0.12, min(max(math.atan2(gy, gx) / 2.5, -0.45), 0.45)
        v, omega = told[k - late] if k >= late else (0.0, 0.0)
        d = v * TICK_S * (1.0 + distance_scale)
        a = omega * TICK_S * (1.0 + turn_scale)
        d += motion_noise * 0.04 * math.sqrt(abs(d)) * rng.standard_normal()
        heading = math.hypot(0.06 * math.sqrt(abs(d)), 0.1 * math.sqrt(abs(a)))
        pose = arc(poses[-1], d, a + motion_noise * heading * rng.standard_normal())
        if carried is not None and k == round(carried[0] / TICK_S):
            pose = carried[1]
        poses.append(pose)
        if k % 10:
            continue
        for number, (x, y) in LANDMARKS.items():
            bx, by = pose.inverse().apply(x, y)
            r, phi = math.hypot(bx, by), math.atan2(by, bx)
            if abs(phi) > 0.5 or r < 0.3:
                continue
            seen = (1.0 + range_scale) * r * (1.0 - depth * (1.0 - math.cos(phi - axis)))
            seen += range_sigma * rng.standard_normal()
            bearing = phi + 0.01 * rng.standard_normal()
            if rng.random() < outliers:
                seen, bearing = rng.uniform(0.5, 6.0), rng.uniform(-0.5, 0.5)
            sightings.append(Sighting(int(times_ns[k + 1]), number, seen, bearing))
    return Recording(
        name=f"simulated {seed}",
        twist_stamps_ns=times_ns,
        twists=told,
        reference=Trajectory(times_ns, np.array([[p.x_m, p.y_m, p.theta_rad] for p in poses])),
        sightings=tuple(sightings),
        landmarks=LANDMARKS,
    )


def start_near(recording, seed=None, sigma=START_SIGMA):
    """A start at the reference's, drawn with its own uncertainty if a seed is given."""
    off = np.zeros(3) if seed is None else sigma * np.random.default_rng(seed).standard_normal(3)
    x, y, theta = (recording.reference.poses[0] + off).tolist()
    return PoseEstimate(
        int(recording.reference.stamps_ns[0]),
        SE2(x, y, theta),
        np.diag(sigma**2),
        LocalisationStatus.LOCALISED,
    )
