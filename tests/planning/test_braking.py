"""Braking before what comes nearer: driven in small steps, against the law of motion itself."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.planning.braking import speed_before

STEP_S = 1e-3


def gap_once_slow_m(gap_m, v, w, a, t, then):
    """Return the gap to one who walks at w once a robot at v has reacted and braked to `then`."""
    time_s = 0.0
    while time_s < t or v > then:
        gap_m -= (v + w) * STEP_S
        time_s += STEP_S
        if time_s >= t:
            v = max(v - a * STEP_S, then)
    return gap_m


@given(
    gap_m=st.floats(0.0, 6.0),
    walks_m_s=st.floats(0.0, 2.0),
    deceleration=st.floats(0.2, 3.0),
    reaction_s=st.floats(0.0, 0.5),
    then_m_s=st.floats(0.0, 0.5),
)
def test_whoever_comes_the_robot_is_slow_by_the_time_the_gap_is_closed(
    gap_m, walks_m_s, deceleration, reaction_s, then_m_s
):
    v = speed_before(gap_m, walks_m_s, deceleration, reaction_s, then_m_s=then_m_s)
    assert v >= then_m_s
    if v > then_m_s + 1e-9:
        left_m = gap_once_slow_m(gap_m, v, walks_m_s, deceleration, reaction_s, then_m_s)
        assert left_m >= -2.0 * STEP_S * (v + walks_m_s)


@given(gap_m=st.floats(0.3, 6.0), walks_m_s=st.floats(0.0, 1.0))
def test_it_is_no_slower_than_it_has_to_be(gap_m, walks_m_s):
    v = speed_before(gap_m, walks_m_s, 0.8, 0.2)
    left_m = gap_once_slow_m(gap_m, v, walks_m_s, 0.8, 0.2, 0.0)
    if v > 0.0:
        assert left_m <= 2.0 * STEP_S * (v + walks_m_s)
        assert gap_once_slow_m(gap_m, 1.05 * v + 0.01, walks_m_s, 0.8, 0.2, 0.0) < 0.0


def test_before_nothing_there_is_no_limit_and_a_body_that_nears_half_as_fast_may_drive_faster():
    assert speed_before(math.inf, 1.0, 0.8, 0.2) == math.inf
    straight, aslant = (speed_before(1.0, 0.5, 0.8, 0.2, closing=c) for c in (1.0, 0.5))
    assert straight < aslant


@pytest.mark.parametrize("gap_m", [-1.0, 0.0])
def test_who_is_there_already_is_not_driven_at(gap_m):
    assert speed_before(gap_m, 0.8, 0.8, 0.2) == 0.0
    assert speed_before(gap_m, 0.8, 0.8, 0.2, then_m_s=0.3) == 0.3
