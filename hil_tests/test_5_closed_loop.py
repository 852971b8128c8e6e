"""Bring-up, fifth step: the control process drives what it is told, and knows where it went."""

import math

import pytest

from hil_tests.rig import Rig
from robotctl.messages.control import SafetyState


def test_it_drives_straight_at_the_speed_it_is_told(armed: Rig) -> None:
    start = armed.truth
    armed.drive(0.4, 0.0, 2.0)
    assert armed.control.state == SafetyState.DRIVING
    assert armed.control.v_m_s == pytest.approx(0.4, rel=0.03)
    assert armed.truth.theta_rad == pytest.approx(start.theta_rad, abs=0.02)
    assert armed.truth.x_m - start.x_m == pytest.approx(0.4 * 2.0, rel=0.15)


def test_positive_omega_turns_the_true_robot_left(armed: Rig) -> None:
    armed.drive(0.0, 1.0, 1.0)
    assert armed.truth.theta_rad > 0.6
    assert armed.control.theta_rad == pytest.approx(armed.truth.theta_rad, abs=0.08)


def test_odometry_agrees_with_the_truth_after_a_loop(armed: Rig) -> None:
    armed.drive(0.3, 0.8, 6.0)
    armed.wait_for_state(SafetyState.ARMED)
    armed.wait(lambda: armed.truth and armed.control, 1, "states")
    difference_m = math.hypot(
        armed.control.x_m - armed.truth.x_m, armed.control.y_m - armed.truth.y_m
    )
    assert difference_m < 0.02 * armed.truth.distance_m


def test_a_velocity_that_is_not_refreshed_expires_and_the_robot_stands(armed: Rig) -> None:
    armed.drive(0.4, 0.0, 1.0)
    armed.wait_for_state(SafetyState.ARMED, 3.0)
    before = armed.truth
    armed.wait(lambda: armed.truth.stamp_ns - before.stamp_ns > 500_000_000, 2, "half a second")
    assert armed.truth.distance_m - before.distance_m < 0.002
