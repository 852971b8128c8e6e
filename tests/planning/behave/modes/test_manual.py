"""MANUAL: sticks."""

import math

import pytest

from robotctl.messages.requests import (
    StickRequest,
)
from robotctl.model.geometry.twist import Twist
from tests.planning.bench import LATER, MANUAL


def test_sticks_scale_to_the_limits_and_expire(differential, make_run):
    run = make_run(differential)
    out = run.step(MANUAL, StickRequest(60_000_000, 0.5, -1.0))
    assert (out.v_m_s, out.omega_rad_s) == (0.4, -2.5)
    assert run.step().v_m_s == 0.4
    out = run.step()
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


def test_the_turn_stick_of_a_drive_and_steer_robot_is_its_steering(steered, make_run):
    run = make_run(steered)
    for forward in (1.0, -0.5):
        out = run.step(MANUAL, StickRequest(LATER, forward, 1.0))
        wanted = steered.drive.inverse(Twist(out.v_m_s, out.omega_rad_s))
        assert wanted.joints_rad == pytest.approx((steered.drive.steering_max_rad,))
        assert out.v_m_s == pytest.approx(forward * 0.8)


@pytest.mark.parametrize("stick", [5.0, math.inf, math.nan])
def test_sticks_out_of_range_never_exceed_the_limits(differential, make_run, stick):
    out = make_run(differential).step(MANUAL, StickRequest(LATER, stick, stick))
    assert abs(out.v_m_s) <= 0.8
    assert abs(out.omega_rad_s) <= 2.5


def test_sticks_steer_again_as_soon_as_the_robot_is_armed_again(differential, make_run):
    run = make_run(differential)
    run.step(MANUAL, StickRequest(LATER, 0.5, 0.0))
    run.enabled = False
    assert run.step().v_m_s == 0.0
    run.enabled = True
    assert run.step(StickRequest(LATER, 0.5, 0.0)).v_m_s > 0.0
