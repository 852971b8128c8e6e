"""The motion of a recorded drive, noise added on purpose, and its start."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.estimation.odometry.estimate import arc_between
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory

_ALIGNED_M: Final = 1.0
"""Distance from the start used to find the heading of a reference without one [m]."""

_NEAR_NS: Final = 1_000_000_000


def increments(odometry: Sequence[SE2]) -> list[SE2]:
    """Return the motion from each pose to the next, in the earlier `base`; the first is zero."""
    return [SE2()] + [before.inverse() @ after for before, after in itertools.pairwise(odometry)]


def with_noise(own: MotionNoise, sigmas: tuple[float, float]) -> MotionNoise:
    """Return the noise of an odometry after `noisy`; variances add."""
    sigma_trans, sigma_rot = sigmas
    return MotionNoise(
        math.hypot(own.e_m_per_sqrt_m, sigma_trans),
        math.hypot(own.f_rad_per_sqrt_m, sigma_rot),
        math.hypot(own.g_rad_per_sqrt_rad, sigma_rot),
    )


def noisy(
    deltas: Sequence[SE2], sigmas: tuple[float, float], rng: np.random.Generator
) -> list[SE2]:
    """Return motions with white noise along the path, so the step length does not matter.

    An early heading error moves the robot sideways: integrated over a path of length d, an error of
    variance Q has the mean effect d / 2, and an independent one of variance d^2 Q / 12 (a Wiener
    process and its integral). Good for turns that are short or on the spot.

    Parameters
    ----------
    deltas
        Motions, each in the earlier `base`.
    sigmas
        Standard deviations: of the distance after 1 m [m], and of the heading after 1 m and after
        1 rad [rad].
    rng
        Generator; three numbers are drawn for each motion, also for one without length.
    """
    if sigmas == (0.0, 0.0) or not deltas:
        return list(deltas)
    distance, turn = np.array([arc_between(delta) for delta in deltas]).T
    unit = rng.standard_normal((3, len(deltas)))
    sigma_heading = sigmas[1] * np.sqrt(np.abs(distance) + np.abs(turn))
    along = sigmas[0] * np.sqrt(np.abs(distance)) * unit[0]
    heading = sigma_heading * unit[1]
    aside = distance * (0.5 * heading + sigma_heading * math.sqrt(1.0 / 12.0) * unit[2])
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)
    added = np.stack([c * along - s * aside, s * along + c * aside, heading], axis=1).tolist()
    return [
        SE2(delta.x_m + x, delta.y_m + y, delta.theta_rad + theta)
        for delta, (x, y, theta) in zip(deltas, added, strict=True)
    ]


def with_noisy_motion(
    recording: Recording, sigmas: tuple[float, float], rng: np.random.Generator
) -> Recording:
    """Return a recording with the noise of `noisy` on its velocities and its odometry."""
    if sigmas == (0.0, 0.0):
        return recording
    steps_s = 1e-9 * np.diff(recording.twist_stamps_ns)[:, None]
    if len(steps_s):
        motions = recording.twists[:-1] * steps_s
        deltas = noisy([arc(SE2(), *motion) for motion in motions.tolist()], sigmas, rng)
        twists = recording.twists.copy()
        found = np.array([arc_between(delta) for delta in deltas])
        np.divide(found, steps_s, out=twists[:-1], where=steps_s > 0.0)
        recording = replace(recording, twists=twists)
    if recording.odometry is None:
        return recording
    poses = [SE2(*row) for row in recording.odometry.poses.tolist()]
    moved = itertools.accumulate(
        noisy(increments(poses)[1:], sigmas, rng), SE2.__matmul__, initial=poses[0]
    )
    rows = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose in moved])
    return replace(recording, odometry=Trajectory(recording.odometry.stamps_ns, rows))


def reference_at(recording: Recording, stamp_ns: int) -> SE2 | None:
    """Return the reference pose at a time; None if there is none."""
    return None if recording.reference is None else recording.reference.at(stamp_ns)


def known_from_ns(recording: Recording) -> int:
    """Return the time from which `start_pose` may know the pose [ns]; 0 without a reference."""
    return 0 if recording.reference is None else int(recording.reference.stamps_ns[0]) - _NEAR_NS


def start_pose(recording: Recording, stamp_ns: int) -> SE2 | None:
    """Return the drive's start at a time, by the reference; None if the reference has none.

    Up to one second before and after the reference its ends count. Without headings, the one with
    which the odometry of the first metre fits best is taken.
    """
    reference = recording.reference
    if reference is None:
        return None
    inside_ns = min(max(stamp_ns, int(reference.stamps_ns[0])), int(reference.stamps_ns[-1]))
    pose = reference.at(inside_ns)
    if pose is None or abs(inside_ns - stamp_ns) > _NEAR_NS:
        return None
    if recording.reference_has_heading:
        return pose
    heading = _aligned_heading(recording.odometry, reference, inside_ns)
    return None if heading is None else SE2(pose.x_m, pose.y_m, heading)


def _aligned_heading(
    odometry: Trajectory | None, reference: Trajectory, begin_ns: int
) -> float | None:
    """Return the heading at a time that aligns the odometry path with the reference [rad].

    Least squares of the positions (Kabsch 1976, in the plane); None if the robot never moves.
    """
    start = None if odometry is None else odometry.at(begin_ns)
    if odometry is None or start is None:
        return None
    pairs = [
        (odometry.at(stamp_ns), row)
        for stamp_ns, row in zip(
            reference.stamps_ns.tolist(), reference.poses.tolist(), strict=True
        )
        if stamp_ns >= begin_ns
    ]
    moved = [((pose.x_m, pose.y_m), row[:2]) for pose, row in pairs if pose is not None]
    away = [math.hypot(x - start.x_m, y - start.y_m) for (x, y), _ in moved]
    end = next((i for i, distance_m in enumerate(away) if distance_m > _ALIGNED_M), len(away) - 1)
    if end < 1 or max(away[: end + 1]) == 0.0:
        return None
    a = np.array([place for place, _ in moved[: end + 1]])
    b = np.array([place for _, place in moved[: end + 1]])
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    cross = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    turn = math.atan2(cross, float(np.sum(a * b)))
    return math.remainder(start.theta_rad + turn, math.tau)
