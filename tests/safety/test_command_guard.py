from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.safety.command_guard import clamp, guard_command

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


TOLERANCE = 1e-6
BOUND = 1.0 + TOLERANCE
BEYOND = math.nextafter(BOUND, 2.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("first", [True, False])
def test_the_last_tolerated_duty_is_clamped_and_the_next_number_stops(sign, first):
    def guarded(duty):
        return guard_command(True, *((duty, 0.5) if first else (0.5, duty)), 0.1, 0.6, 0.2)

    clamped = (sign, 0.5) if first else (0.5, sign)
    assert guarded(sign * BOUND) == (True, *clamped, 0.1, "")
    assert guarded(sign * math.nextafter(BOUND, 0.0)) == (True, *clamped, 0.1, "")
    assert guarded(sign * BEYOND)[:4] == (False, 0.0, 0.0, 0.2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("enable", [True, False])
def test_the_last_tolerated_steering_is_clamped_and_the_next_number_stops(sign, enable):
    bound = 0.6 + TOLERANCE
    duty = 0.5 if enable else 0.0
    clamped = (enable, duty, duty, sign * 0.6, "")
    assert guard_command(enable, 0.5, 0.5, sign * bound, 0.6, 0.2) == clamped
    out = guard_command(enable, 0.5, 0.5, sign * math.nextafter(bound, 2.0), 0.6, 0.2)
    assert out[:4] == (False, 0.0, 0.0, 0.2)
    assert out.fault.endswith("rad: 0.6 rad to either side allowed")


@pytest.mark.parametrize(
    ("held", "kept"),
    [(0.2, 0.2), (0.6, 0.6), (0.7, 0.6), (-0.7, -0.6)]
    + [(bad, 0.0) for bad in (math.nan, math.inf, -math.inf)],
)
def test_the_held_angle_is_bounded_as_well_and_straight_where_it_is_no_number(held, kept):
    assert guard_command(True, math.nan, 0.0, 0.0, 0.6, held).steering_rad == kept


def test_without_a_held_angle_the_wheels_go_straight_and_the_linkage_bound_is_a_right_angle():
    assert guard_command(True, 2.0, 0.0, 0.3).steering_rad == 0.0
    quarter = math.pi / 2
    assert guard_command(True, 0.0, 0.0, quarter).steering_rad == quarter
    assert guard_command(True, 0.0, 0.0, quarter + 2 * TOLERANCE).fault


def test_the_refusal_names_what_was_found_and_what_is_allowed():
    assert guard_command(True, 1.5, -0.5, 0.0).fault == "duties 1.5, -0.5: [-1, 1] allowed"
    out = guard_command(True, 0.0, 0.0, 0.7, 0.6)
    assert out.fault == "steering 0.7 rad: 0.6 rad to either side allowed"


@pytest.mark.parametrize(
    ("value", "clamped"), [(0.5, 0.5), (-0.5, -0.5), (0.6, 0.5), (-0.6, -0.5), (0.0, 0.0)]
)
def test_clamp_limits_both_sides(value, clamped):
    assert clamp(value, 0.5) == clamped
    assert clamp(value, 0.0) == 0.0


def test_clamp_keeps_what_is_no_number():
    assert math.isnan(clamp(math.nan, 0.5))
