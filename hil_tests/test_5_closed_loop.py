"""Bring-up, fifth step: the control process drives what it is told, and knows where it went."""

import math

import pytest

from hil_tests.rig import Rig
from robotctl.messages.control import SafetyState
from robotctl.model.geometry.angles import wrap_angle


def test_it_drives_straight_at_the_speed_it_is_told(lasting: Rig) -> None:
    start = lasting.truth
    lasting.drive(0.4, 0.0, 2.0)
    assert lasting.control.state == SafetyState.DRIVING
    assert lasting.control.v_m_s == pytest.approx(0.4, rel=0.03)
    assert lasting.truth.theta_rad == pytest.approx(start.theta_rad, abs=0.02)
    assert lasting.truth.x_m - start.x_m == pytest.approx(0.4 * 2.0, rel=0.15)


def test_positive_omega_turns_the_true_robot_left(lasting: Rig) -> None:
    before = lasting.fresh_truth()
    lasting.drive(0.0, 1.0, 1.0)
    assert wrap_angle(lasting.truth.theta_rad - before.theta_rad) > 0.6
    assert wrap_angle(lasting.control.theta_rad - lasting.truth.theta_rad) == pytest.approx(
        0.0, abs=0.08
    )


def test_odometry_agrees_with_the_truth_after_a_loop(lasting: Rig) -> None:
    lasting.drive(0.3, 0.8, 6.0)
    lasting.wait_for_state(SafetyState.ARMED)
    lasting.wait(lambda: lasting.truth and lasting.control, 1, "states")
    difference_m = math.hypot(
        lasting.control.x_m - lasting.truth.x_m, lasting.control.y_m - lasting.truth.y_m
    )
    assert difference_m < 0.02 * lasting.truth.distance_m


def test_a_velocity_that_is_not_refreshed_expires_and_the_robot_stands(lasting: Rig) -> None:
    lasting.drive(0.4, 0.0, 1.0)
    lasting.wait_for_state(SafetyState.ARMED, 3.0)
    before = lasting.truth
    lasting.wait(lambda: lasting.truth.stamp_ns - before.stamp_ns > 500_000_000, 2, "half a second")
    assert lasting.truth.distance_m - before.distance_m < 0.002
