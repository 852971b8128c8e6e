"""Pure pursuit: its geometry, its reach and its stops."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.drives.motion import arc, integrate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.local.path import Path, rounded
from robotctl.planning.path.local.pursuit import Pursuit, miss_m, turn_rate

CONFIG = PursuitConfig()
STRAIGHT = Path([(0.0, 0.0), (5.0, 0.0)])


def follow(drive, path, start, speed=0.4, reverse=False, seconds=60.0):
    """Drive an ideal robot along `path`; return poses and steps."""
    pursuit = Pursuit(path, CONFIG, drive, speed, reverse=reverse)
    pose, twist, poses, steps = start, Twist(0.0, 0.0), [start], []
    for _ in range(int(seconds / 0.05)):
        step = pursuit.step(pose, twist)
        steps.append(step)
        if step.done:
            return poses, steps
        wanted = drive.inverse(Twist(step.v_m_s, step.omega_rad_s))
        twist = drive.forward(wanted.wheels_rad_s, wanted.joints_rad)
        pose = integrate(pose, twist, 0.05)
        poses.append(pose)
    raise AssertionError(f"not there after {seconds} s: {steps[-1]}")


def off(path, pose):
    return path.project(pose.x_m, pose.y_m, 0.0, path.length_m).distance_m


def test_the_arc_commanded_leads_through_the_point_ahead(differential):
    pursuit = Pursuit(STRAIGHT, CONFIG, differential.drive, 0.4)
    pose = SE2(0.4, 0.1, 0.2)
    step = pursuit.step(pose, Twist(0.4, 0.0))
    R = step.v_m_s / step.omega_rad_s
    goal = (0.4 + 0.8 * 0.4, 0.0)
    centre = pose.apply(0.0, R)
    assert math.dist(centre, goal) == pytest.approx(abs(R))


def test_a_path_is_followed_to_its_end_and_the_robot_stops_there(robot):
    path = Path(rounded([(0, 0), (3, 0), (3, 3), (0, 3)], 0.7))
    poses, steps = follow(robot.drive, path, SE2())
    assert max(off(path, pose) for pose in poses) < 0.06
    assert math.dist((poses[-1].x_m, poses[-1].y_m), (0.0, 3.0)) < 0.07
    assert abs(steps[-2].v_m_s) < 0.22  # braking with 0.4 m/s^2, 0.05 m before the goal


def test_an_offset_start_converges_to_the_path(robot):
    poses, _ = follow(robot.drive, STRAIGHT, SE2(0.0, 0.3, 0.2))
    assert poses[-1].x_m > 2.0
    assert all(abs(pose.y_m) < 0.02 for pose in poses if pose.x_m > 2.0)


def test_reverse_gear_drives_tail_first_along_the_path(robot):
    path = Path(rounded([(0, 0), (-3, 0), (-3, 3)], 0.8))
    poses, steps = follow(robot.drive, path, SE2(0.0, 0.1, 0.0), reverse=True)
    assert all(step.v_m_s <= 0.0 for step in steps)
    assert off(path, poses[-1]) < 0.05
    assert poses[-1].theta_rad == pytest.approx(-math.pi / 2, abs=0.1)


def test_a_differential_drive_turns_on_the_spot_towards_a_path_behind_it(differential):
    pursuit = Pursuit(STRAIGHT, CONFIG, differential.drive, 0.4)
    step = pursuit.step(SE2(0.0, 0.0, math.pi - 0.1), Twist(0.0, 0.0))
    assert step.v_m_s == 0.0
    assert step.omega_rad_s < 0.0
    poses, _ = follow(differential.drive, STRAIGHT, SE2(0.0, 0.0, math.pi - 0.1))
    assert min(pose.x_m for pose in poses) > -0.05


@given(x=st.floats(0, 5), y=st.floats(-0.4, 0.4), theta=st.floats(-math.pi, math.pi))
def test_drive_and_steer_robots_only_get_arcs_they_can_drive(x, y, theta):
    from robotctl.model.drives.drives import TricycleDrive

    drive = TricycleDrive("tricycle", "front", 0.32, 0.05, 0.6, 2.0, 2400)
    step = Pursuit(STRAIGHT, CONFIG, drive, 0.4).step(SE2(x, y, theta), Twist(0.2, 0.0))
    assert abs(step.omega_rad_s) <= abs(step.v_m_s) / drive.min_turning_radius_m + 1e-12
    assert step.done or step.v_m_s > 0.0


def test_it_slows_down_ahead_of_a_sharp_corner(differential):
    corner = Path([(0, 0), (2, 0), (2, 2)])
    poses, steps = follow(differential.drive, corner, SE2())
    speed_at = {
        round(p.x_m, 1): s.v_m_s for p, s in zip(poses, steps, strict=False) if p.y_m < 0.05
    }
    assert speed_at[1.0] == pytest.approx(0.4)
    assert speed_at[1.9] < 0.3
    assert max(off(corner, pose) for pose in poses) < 0.15


def test_the_speed_on_the_way_never_asks_for_more_than_the_planned_braking(robot):
    path = Path([(0, 0), (2, 0)])
    _, steps = follow(robot.drive, path, SE2())
    for step in steps:
        limit = math.sqrt(2 * CONFIG.acceleration_m_s2 * step.remaining_m)
        assert step.v_m_s <= max(limit, CONFIG.creep_m_s) + 1e-9


def test_a_wanted_speed_below_creeping_is_kept(robot):
    _, steps = follow(robot.drive, Path([(0, 0), (0.3, 0)]), SE2(), speed=0.02)
    assert max(step.v_m_s for step in steps) == pytest.approx(0.02)


@given(st.floats(-math.pi, math.pi))
def test_a_turn_on_the_spot_closes_the_error_without_overshoot(error):
    start = error
    for _ in range(200):
        error -= turn_rate(error, CONFIG) * 0.05
        assert abs(error) <= abs(start) + 1e-12
        assert error * start >= -1e-12
    assert abs(error) < 1e-3


@given(st.floats(0.5, 3.0), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0))
def test_an_arc_of_more_than_the_smallest_radius_ends_at_a_point_in_reach(radius, angle, side):
    radius = math.copysign(radius, side)
    end = arc(SE2(), radius * angle, angle)
    assert miss_m(SE2(), end.x_m, end.y_m, 0.5) < 1e-9


def test_a_point_beside_the_robot_is_missed_by_its_depth_in_the_turning_circle():
    assert miss_m(SE2(), 0.0, 0.5, 0.5) == pytest.approx(0.5)
    assert miss_m(SE2(0, 0, math.pi / 2), 0.1, 0.0, 0.5) == pytest.approx(0.1)


@pytest.mark.parametrize("key", [f.name for f in dataclasses.fields(PursuitConfig)])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_setting_that_is_not_positive_is_refused_by_name(key, value):
    with pytest.raises(ValueError, match=key):
        PursuitConfig(**{key: value})
