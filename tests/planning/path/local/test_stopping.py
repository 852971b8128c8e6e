"""No controller takes a velocity from which the robot could not stop, whatever stands around it."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import AckermannDrive, DifferentialDrive, MecanumDrive
from robotctl.model.drives.motion import integrate
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.local.controller import ControllerConfig, LocalSituation
from robotctl.planning.path.local.controllers import CONTROLLERS

SIDE_M = 0.05
LIMITS = LimitsConfig(2.0, 4.0, 4.0, 12.0, 40.0, 150.0, vy_max_m_s=1.5)
CONFIG = ControllerConfig(deceleration_m_s2=3.0, samples=60, tau_s=0.1, reaction_s=0.0)
"""It looks less far ahead than it brakes, and the check has no time to spare."""
TURN_BRAKE_RAD_S2 = 9.0
"""The same share of the largest."""
ROBOTS = {
    "differential": (
        DifferentialDrive("differential", 0.37, 0.1, 2400),
        Footprint(((0.25, -0.21), (0.25, 0.21), (-0.25, 0.21), (-0.25, -0.21))),
    ),
    "mecanum": (
        MecanumDrive("mecanum", 0.4, 0.36, 0.076, 8192),
        Footprint(((0.25, -0.21), (0.25, 0.21), (-0.25, 0.21), (-0.25, -0.21))),
    ),
    "ackermann": (
        AckermannDrive("ackermann", 0.35, 0.26, 0.05, 0.6, 2.0, 2400),
        Footprint(((0.43, -0.15), (0.43, 0.15), (-0.07, 0.15), (-0.07, -0.15))),
    ),
    "with an arm": (
        DifferentialDrive("differential", 0.37, 0.1, 2400),
        Footprint(
            ((0.25, -0.5), (0.25, 0.21), (-0.25, 0.21), (-0.25, -0.21), (0.15, -0.21), (0.15, -0.5))
        ),
    ),
    "with jaws": (
        MecanumDrive("mecanum", 0.4, 0.36, 0.076, 8192),
        Footprint(
            ((0.2, -0.21), (0.2, 0.21), (-0.25, 0.21), (-0.25, -0.21)),
            tuple(((0.1, y), (0.4, y), (0.4, y + 0.08), (0.1, y + 0.08)) for y in (-0.21, 0.13)),
        ),
    ),
}


def touches(footprint, cells, poses):
    """Return whether a body overlaps a cell at one of the poses, by separating axes."""
    return any(piece_touches(piece, cells, poses) for piece in footprint.pieces)


def piece_touches(corners, cells, poses):
    """Return the same of a convex piece of it."""
    x, y, angle = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses]).T
    near = np.abs(cells + 0.5 * SIDE_M - (x[0], y[0])).max(axis=1) < 2.5
    cells = cells[near]
    c, s = np.cos(angle), np.sin(angle)
    body = np.array(corners) @ np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
    body += np.stack([x, y], axis=1)[:, np.newaxis]
    apart = (body.max(axis=1)[:, np.newaxis] <= cells).any(axis=2)
    apart |= (body.min(axis=1)[:, np.newaxis] >= cells + SIDE_M).any(axis=2)
    after = np.roll(body, -1, axis=1)
    for k in range(body.shape[1]):
        (ax, ay), (bx, by) = body[:, k].T, after[:, k].T
        nx, ny = by - ay, ax - bx  # outwards
        nearest = np.outer(nx, cells[:, 0]) + np.outer(ny, cells[:, 1])
        nearest += (SIDE_M * (np.minimum(nx, 0.0) + np.minimum(ny, 0.0)))[:, np.newaxis]
        apart |= nearest >= (nx * ax + ny * ay)[:, np.newaxis]
    return not apart.all()


def braking(pose, twist):
    """Return poses 5 ms apart of a robot that brakes on its arc."""
    whole_s = max(
        math.hypot(twist.v_m_s, twist.vy_m_s) / CONFIG.deceleration_m_s2,
        abs(twist.omega_rad_s) / TURN_BRAKE_RAD_S2,
    )
    poses = [pose]
    count = math.ceil(whole_s / 0.005)
    for i in range(count):
        left = 1.0 - (i + 0.5) / count
        slower = Twist(*(left * each for each in twist))
        poses.append(integrate(poses[-1], slower, whole_s / count))
    return poses


@pytest.mark.parametrize("kind", ROBOTS)
@pytest.mark.parametrize("name", CONTROLLERS)
@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.filter_too_much],  # long jaws seldom have room to start
)
@given(st.integers(0, 2**32 - 1))
def test_after_each_step_braking_ends_before_anything_is_touched(name, kind, seed):
    drive, body = ROBOTS[kind]
    rng = np.random.default_rng(seed)
    grid = np.where(rng.random((80, 80)) < rng.uniform(0.0, 0.04), 100, 0).astype(np.int8)
    grid[34:46, 34:46] = 0
    space = PlanningMap(GridMap(grid, SIDE_M), body)
    cells = SIDE_M * np.argwhere(np.pad(space.blocked, 1, constant_values=True))[:, ::-1] - SIDE_M
    pose, v = SE2(2.0, 2.0, rng.uniform(-3.0, 3.0)), rng.uniform(-2.0, 2.0)
    reach = min(4.0, abs(v) / drive.min_turning_radius_m) if drive.steered else 4.0
    twist = Twist(v, rng.uniform(-reach, reach))
    if drive.holonomic:
        twist = twist._replace(vy_m_s=rng.uniform(-1.5, 1.5))
    path = np.array([[2.0, 2.0, 0.0], *rng.uniform(-1.0, 5.0, (3, 3))])
    reverse = rng.random(3) < 0.3
    # A corner that is grazed between two of the poses is in the way, too.
    corners, *parts = (tuple((1.02 * x, 1.02 * y) for x, y in each) for each in body.outlines)
    roomy = Footprint(corners, tuple(parts))
    assume(not touches(roomy, cells, braking(pose, twist)))
    controller = CONTROLLERS[name](CONFIG, drive, LIMITS, body)
    for i in range(20):
        effort = (1.0, 0.125)[i % 2]
        situation = LocalSituation(pose, twist, path, reverse, space, np.empty((0, 5)), 2.0, effort)
        motion = controller.step(situation)
        twist = Twist(motion.v_m_s, motion.omega_rad_s, motion.vy_m_s)
        driven = [integrate(pose, twist, 0.005 * (i + 1)) for i in range(10)]
        pose = driven[-1]
        assert not touches(body, cells, driven + braking(pose, twist))
        if drive.steered:
            assert abs(twist.omega_rad_s) * drive.min_turning_radius_m <= abs(twist.v_m_s) + 1e-9
