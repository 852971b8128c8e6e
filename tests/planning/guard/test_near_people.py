"""The speed near people, with a robot and a person that move in small steps."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.echo_motion import STANDS, ApproachingEcho
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.guard_config import NearPeopleConfig

FRONT = SonarMount("front", 0.2, 0.0, 0.0)
REAR = SonarMount("rear", -0.2, 0.0, 180.0)
RADIUS_M = 0.2
NOSE_M = 0.2
STEP_S = 0.05


def guard_of(near_m, speed_m_s=0.3, mounts=(FRONT, REAR)):
    people = NearPeopleConfig(near_m=near_m, speed_m_s=speed_m_s)
    return ObstacleGuard(GuardConfig(people=people), mounts)


def sees(guard, x_m, y_m=0.0, vx_m_s=0.0):
    moving = [[x_m, y_m, vx_m_s, 0.0, RADIUS_M]]
    guard.observe((4.0,) * 2, (True,) * 2, moving_base=moving)


@settings(max_examples=50, deadline=None)
@given(
    gap_m=st.floats(1.0, 6.0),
    walks_m_s=st.floats(0.0, 1.5),
    near_m=st.floats(0.1, 1.5),
    slow_m_s=st.floats(0.05, 0.5),
)
def test_near_somebody_it_is_slow_however_they_come(gap_m, walks_m_s, near_m, slow_m_s):
    guard, config = guard_of(near_m, slow_m_s), GuardConfig()
    # The drives follow that late: a step is commanded at its beginning and lasts to its end.
    v, wanted = 0.0, [0.0] * (round(config.reaction_s / STEP_S) - 1)
    for _ in range(200):
        sees(guard, gap_m + NOSE_M + RADIUS_M, vx_m_s=-walks_m_s)
        wanted.append(min(guard.step(0.8).v_max_m_s, 0.8))
        v = max(min(wanted.pop(0), v + 2.0 * STEP_S), v - config.deceleration_m_s2 * STEP_S)
        gap_m -= (v + walks_m_s) * STEP_S
        if gap_m < 0.0:
            break
        if gap_m < near_m - 2.0 * (v + walks_m_s) * STEP_S:
            assert v <= slow_m_s + config.deceleration_m_s2 * STEP_S  # what a step brakes


@pytest.mark.parametrize(("x_m", "v"), [(0.9, 0.8), (0.9, -0.8), (-0.9, 0.8)])
def test_it_is_slow_in_all_directions_and_free_again_where_nobody_is(x_m, v):
    guard = guard_of(1.0)
    sees(guard, x_m)
    assert guard.step(v).v_max_m_s == pytest.approx(0.3)
    assert guard.step(v).obstacle == "somebody is near"
    guard.observe((4.0, 4.0), (True, True))
    assert guard.step(v).v_max_m_s > 0.8


def test_what_a_sonar_hears_come_nearer_is_somebody_too():
    guard = guard_of(1.0)
    echo = ApproachingEcho(1.1, 0.3)
    guard.observe((4.0, 4.0), (True, True), approaches=(STANDS, echo))
    assert guard.step(0.8).v_max_m_s == pytest.approx(0.3)


def test_it_is_off_by_default():
    guard = ObstacleGuard(GuardConfig(), (FRONT, REAR))
    sees(guard, 0.6)
    assert guard.step(0.8).v_max_m_s > 0.8
