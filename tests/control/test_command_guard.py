from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.command_guard import guard_command

anything = st.floats()


@settings(deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.6, 0.6))
def test_a_good_command_passes_unchanged(duty1, duty2, steering):
    assert guard_command(True, duty1, duty2, steering, 0.6) == (True, duty1, duty2, steering, "")


@settings(deadline=None)
@given(st.booleans(), anything, anything, anything, st.floats(0.0, 1.5), anything)
def test_whatever_comes_in_a_safe_command_goes_out(enable, duty1, duty2, steering, bound, held):
    out = guard_command(enable, duty1, duty2, steering, bound, held)
    assert abs(out.duty1) <= 1.0
    assert abs(out.duty2) <= 1.0
    assert abs(out.steering_rad) <= bound
    if not out.enable:
        assert out.duty1 == out.duty2 == 0.0
    assert not (out.enable and not enable)
    assert not (out.enable and out.fault)


def test_not_enabled_means_zero_duty():
    assert guard_command(False, 0.7, -0.7, 0.1) == (False, 0.0, 0.0, 0.1, "")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.001, -1.001])
@pytest.mark.parametrize("first", [True, False])
def test_one_bad_duty_stops_both_wheels_and_holds_the_steering(bad, first):
    duties = (bad, 0.5) if first else (0.5, bad)
    out = guard_command(True, *duties, 0.3, 0.6, 0.2)
    assert (out.enable, out.duty1, out.duty2, out.steering_rad) == (False, 0.0, 0.0, 0.2)
    assert str(bad) in out.fault


@pytest.mark.parametrize("bad", [math.nan, math.inf, 0.61, -0.61])
def test_a_bad_steering_angle_stops_the_robot(bad):
    out = guard_command(True, 0.5, 0.5, bad, 0.6, -0.4)
    assert (out.enable, out.duty1, out.steering_rad) == (False, 0.0, -0.4)
    assert str(bad) in out.fault


def test_rounding_at_the_bound_is_clamped_and_no_fault():
    out = guard_command(True, 1.0 + 1e-9, -1.0 - 1e-9, 0.6 + 1e-9, 0.6)
    assert out == (True, 1.0, -1.0, 0.6, "")
