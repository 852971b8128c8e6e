from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.actuators import Abilities, Actuator, Takes
from robotctl.safety.command_guard import Bound, bounds, clamp, guarded

TOLERANCE = 1e-6
ABILITIES = Abilities(Takes.DUTY, stops_alone=True, brakes=True)
ROBOT = tuple(
    Actuator(name, "drive", takes, 2400, ABILITIES)
    for name, takes in (("left", Takes.DUTY), ("right", Takes.SPEED), ("steering", Takes.ANGLE))
)
BOUNDS = bounds(ROBOT, 20.0, (0.6,))
anything = st.floats()


def test_each_actuator_has_the_bound_of_what_it_takes():
    assert (
        Bound("left", 1.0, "duty"),
        Bound("right", 20.0, "rad/s"),
        Bound("steering", 0.6, "rad"),
    ) == BOUNDS


@settings(deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-20.0, 20.0), st.floats(-0.6, 0.6))
def test_a_good_command_passes_unchanged(duty, speed, angle):
    assert guarded((duty, speed, angle), BOUNDS) == (duty, speed, angle)


@settings(deadline=None)
@given(anything, anything, anything)
def test_whatever_comes_in_what_goes_out_is_within_all_bounds(duty, speed, angle):
    out = guarded((duty, speed, angle), BOUNDS)
    if isinstance(out, Fault):
        assert out.code is FaultCode.COMMAND_GUARD
    else:
        assert all(abs(value) <= bound.most for value, bound in zip(out, BOUNDS, strict=True))


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 20.1, -20.1])
def test_one_bad_value_refuses_the_command_for_all(place, bad):
    values = [0.5, 0.5, 0.3]
    values[place] = bad
    fault = guarded(tuple(values), BOUNDS)
    assert isinstance(fault, Fault)
    assert fault.part == BOUNDS[place].name
    assert str(bad) in fault.text


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_last_tolerated_value_is_clamped_and_the_next_number_refused(sign, place):
    most = BOUNDS[place].most
    last = most + TOLERANCE
    values = [0.5, 0.5, 0.3]
    values[place] = sign * last
    clamped = list(values)
    clamped[place] = sign * most
    assert guarded(tuple(values), BOUNDS) == tuple(clamped)
    values[place] = sign * math.nextafter(last, math.inf)
    assert isinstance(guarded(tuple(values), BOUNDS), Fault)


def test_the_refusal_names_what_was_found_and_what_is_allowed():
    said = "command guard: left 1.5 duty: 1 to either side allowed"
    assert guarded((1.5, -0.5, 0.0), BOUNDS).text == said
    said = "command guard: steering 0.7 rad: 0.6 to either side allowed"
    assert guarded((0.0, 0.0, 0.7), BOUNDS).text == said


def test_values_for_other_actuators_than_there_are_are_refused():
    assert guarded((0.0, 0.0), BOUNDS).text == "command guard: 2 values for 3 actuators"


@pytest.mark.parametrize(
    ("value", "clamped"), [(0.5, 0.5), (-0.5, -0.5), (0.6, 0.5), (-0.6, -0.5), (0.0, 0.0)]
)
def test_clamp_limits_to_both_sides(value, clamped):
    assert clamp(value, 0.5) == clamped
    assert clamp(value, 0.0) == 0.0


def test_clamp_leaves_what_is_no_number():
    assert math.isnan(clamp(math.nan, 0.5))
