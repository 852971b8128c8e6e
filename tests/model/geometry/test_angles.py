"""Angles and planar motion against closed forms of the notes and a fine integration."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.drives.motion import arc, integrate, straight, turn
from robotctl.model.geometry.angles import sinc, wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist

angles = st.floats(-50.0, 50.0)
small = st.floats(-1e-3, 1e-3)
lengths = st.floats(-5.0, 5.0)
poses = st.builds(SE2, lengths, lengths, st.floats(-math.pi, math.pi))


def assert_close(a: SE2, b: SE2, tolerance: float = 1e-9) -> None:
    assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < tolerance
    assert abs(wrap_angle(a.theta_rad - b.theta_rad)) < tolerance


@given(angles)
def test_a_wrapped_angle_lies_in_the_half_open_circle_and_points_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-12)


def test_both_ends_of_the_circle_wrap_to_plus_pi():
    assert wrap_angle(-math.pi) == math.pi
    assert wrap_angle(math.pi) == math.pi
    assert wrap_angle(3 * math.pi) == pytest.approx(math.pi)


def test_wrapping_hides_no_nan_and_refuses_infinity():
    assert math.isnan(wrap_angle(math.nan))
    with pytest.raises(ValueError, match="math domain"):
        wrap_angle(math.inf)


@given(st.floats(-2e-4, 2e-4))
def test_sinc_meets_its_series_on_both_sides_of_the_switch(x):
    assert sinc(x) == pytest.approx(1 - x**2 / 6 + x**4 / 120, rel=1e-15)


@given(poses, st.floats(0.1, 5.0), st.sampled_from([-1.0, 1.0]), st.floats(-3.0, 3.0))
def test_an_arc_is_the_closed_formula_of_the_notes(pose, radius, side, angle):
    R = side * radius
    t = pose.theta_rad
    expected = SE2(
        pose.x_m + R * (math.sin(t + angle) - math.sin(t)),
        pose.y_m - R * (math.cos(t + angle) - math.cos(t)),
        t + angle,
    )
    assert_close(arc(pose, R * angle, angle), expected)


@given(poses, lengths)
def test_an_arc_without_angle_is_straight(pose, distance):
    assert_close(arc(pose, distance, 0.0), straight(pose, distance))


@given(poses, lengths, small)
def test_an_arc_goes_over_into_straight_motion_without_a_jump(pose, distance, angle):
    difference = arc(pose, distance, angle)
    line = straight(pose, distance)
    gap = math.hypot(difference.x_m - line.x_m, difference.y_m - line.y_m)
    assert gap == pytest.approx(abs(distance * angle) / 2, rel=1e-5, abs=1e-12)


@given(poses, angles)
def test_an_arc_without_length_is_a_turn_on_the_spot(pose, angle):
    assert_close(arc(pose, 0.0, angle), turn(pose, angle))


@given(poses, lengths, st.floats(-6.0, 6.0), st.floats(0.0, 1.0))
def test_an_arc_in_two_parts_ends_where_the_whole_ends(pose, distance, angle, share):
    parts = arc(
        arc(pose, share * distance, share * angle), (1 - share) * distance, (1 - share) * angle
    )
    assert_close(parts, arc(pose, distance, angle))


@given(poses, lengths, st.floats(-6.0, 6.0))
def test_driving_an_arc_back_returns_to_its_start(pose, distance, angle):
    assert_close(arc(arc(pose, distance, angle), -distance, -angle), pose)


@given(poses, lengths, st.floats(-6.0, 6.0))
def test_an_arc_is_the_exponential_of_its_twist(pose, distance, angle):
    assert_close(pose @ SE2.exp(distance, 0.0, angle), arc(pose, distance, angle))


@pytest.mark.parametrize(("v", "omega"), [(0.5, 0.0), (0.5, 1e-9), (0.4, -0.7), (0.0, 1.2)])
def test_exact_integration_agrees_with_many_runge_kutta_steps(v, omega):
    start, dt, n = SE2(1.0, -2.0, 2.5), 3.0, 2000
    x, y, theta, h = start.x_m, start.y_m, start.theta_rad, dt / n
    for _ in range(n):
        middle = theta + 0.5 * h * omega
        # x' and y' depend on theta alone: the fourth-order Runge-Kutta step is Simpson's rule
        x += h * v / 6 * (math.cos(theta) + 4 * math.cos(middle) + math.cos(theta + h * omega))
        y += h * v / 6 * (math.sin(theta) + 4 * math.sin(middle) + math.sin(theta + h * omega))
        theta += h * omega
    assert_close(integrate(start, Twist(v, omega), dt), SE2(x, y, theta), 1e-9)
