"""Keeping a distance by the front sonar, against the closed forms of the loop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behave.behaviours.keep_distance import KeepDistance, KeepDistanceItem
from robotctl.planning.behave.behaviours.kind import Abilities, NavigatedRobot
from robotctl.planning.behave.mission.check import check_mission
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from robotctl.planning.config import GuardConfig, NavigationConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard

BODY = GuardConfig().outline(())

WALL_X_M, WANTED_M, DT_S = 4.95, 0.5, 0.05
AUTO, HOLD = ModeRequest(Mode.AUTO), ModeRequest(Mode.HOLD)
GAIN_1_S = 8**8 / 9**9 / DT_S  # of a double real pole, 8 steps of 0.05 s after each reading


def keeping(robot, *, sees_back=True, **item):
    """Return the behaviour of a robot."""
    mounts = robot.mounts if sees_back else robot.mounts[:3]
    config = NavigationConfig()
    guard, crumbs = ObstacleGuard(config.guard, mounts), Breadcrumbs(SE2(), steered=False)
    navigated = NavigatedRobot(config, robot.drive, mounts, guard, crumbs)
    return KeepDistance(KeepDistanceItem("keep_distance", WANTED_M, 30.0, **item), navigated)


def see(front_m, theta_rad=0.0, *, new=True, others=7):
    ranges = (front_m, *(math.inf,) * others)
    return BehaviourInput(SE2(0, 0, theta_rad), Twist(0, 0), ranges, (new,) * len(ranges))


def run_to(make_run, robot, gap_m, duration_s=15.0, **world):
    """Return a run before the wall between the rooms, `gap_m` from the front sonar."""
    item = KeepDistanceItem("keep_distance", WANTED_M, duration_s)
    mission = Mission("keep", StartPose(1.0, 1.0), (item,))
    run = make_run(robot, mission=mission, start=SE2(WALL_X_M - gap_m - robot.front, 1.0), **world)
    run.step(AUTO)
    return run


def gap(run, robot):
    return WALL_X_M - run.world.pose.x_m - robot.front


@pytest.mark.parametrize("error_m", [0.3, -0.3])
def test_the_step_response_is_that_of_the_difference_equation(differential, error_m):
    """With the median of three the loop is e'' = e' - K e: its two roots are real."""
    keep, error, found = keeping(differential), error_m, []
    for step in range(80):
        found.append(error)
        error -= DT_S * keep.step(see(WANTED_M + error), step * 50_000_000).v_m_s
    K = GAIN_1_S * DT_S
    high, low = ((1.0 + sign * math.sqrt(1.0 - 4.0 * K)) / 2.0 for sign in (1.0, -1.0))
    # From the second step on; there the median is of two readings, of which the nearer counts.
    a, b = np.linalg.solve([[1.0, 1.0], [high, low]], found[2:4])
    moving = [k for k, each in enumerate(found[2:]) if abs(each) > 0.03]
    expected = [a * high**k + b * low**k for k in moving]
    assert len(moving) > 40
    assert [found[2 + k] for k in moving] == pytest.approx(expected, abs=1e-9)
    assert all(each * error_m >= 0.0 for each in found)  # no overshoot
    assert abs(found[-1]) <= 0.02


@pytest.mark.parametrize("gap_m", [1.3, 0.2])
def test_each_robot_comes_to_the_distance_from_either_side(make_run, robot, gap_m):
    run = run_to(make_run, robot, gap_m, range_noise_m=0.005, outliers=0.02)
    out = run.until(lambda out: out.state.mission_completed, 16.0)
    assert out.state.mission_completed
    assert gap(run, robot) == pytest.approx(WANTED_M, abs=0.04)
    assert min(WALL_X_M - pose.x_m - robot.front for pose in run.trace) > min(gap_m, 0.45)
    assert run.world.touched == 0


def test_it_follows_what_walks_away_by_the_lag_of_a_ramp(make_run, differential):
    """A proportional loop follows a ramp of speed v at the distance v / kp behind its reference."""
    speed = 0.15
    run = run_to(make_run, differential, 3.5, duration_s=12.0)
    box_x = run.world.pose.x_m + differential.front + WANTED_M
    lags = []
    for _ in range(200):
        run.world.obstacle = np.array([(box_x, 0.6, box_x, 1.4)])
        run.step()
        box_x += speed * DT_S
        lags.append(box_x - run.world.pose.x_m - differential.front - WANTED_M)
    assert np.mean(lags[-40:]) == pytest.approx(speed / GAIN_1_S, abs=0.04)
    assert run.world.touched == 0


def test_a_missing_reading_stops_it_at_once_and_no_echo_for_long_fails(differential):
    keep, now_ns = keeping(differential), 0
    for _ in range(3):
        assert keep.step(see(1.0), now_ns).v_m_s > 0.1
        now_ns += 50_000_000
    assert keep.step(see(math.nan, new=False), now_ns)[:2] == (0.0, 0.0)
    for _ in range(3):
        now_ns += 50_000_000
        assert keep.step(see(math.inf), now_ns)[:3] == (0.0, 0.0, Status.RUNNING)
    assert keep.step(see(math.inf), now_ns + 10_100_000_000).status is Status.FAILED


def test_the_heading_of_the_beginning_is_held_by_who_can_turn_on_the_spot(robot):
    keep = keeping(robot)
    keep.step(see(1.0, 0.3), 0)
    turned_left, turned_right = (keep.step(see(1.0, 0.3 + off), 0) for off in (0.1, -0.1))
    if robot.drive.steered:
        assert turned_left.omega_rad_s == turned_right.omega_rad_s == 0.0
    else:
        assert turned_left.omega_rad_s < 0.0 < turned_right.omega_rad_s


def test_it_backs_up_only_where_a_sonar_looks_back(differential):
    assert keeping(differential).step(see(0.3), 0).v_m_s < -0.1
    blind = keeping(differential, sees_back=False).step(see(0.3, others=2), 0)
    assert (blind.v_m_s, blind.omega_rad_s) == (0.0, 0.0)
    assert "rear sonar" in blind.text


def test_the_speed_is_bounded_and_time_in_another_mode_does_not_count(make_run, differential):
    assert keeping(differential, speed_m_s=0.1).step(see(3.0), 0).v_m_s == 0.1
    run = run_to(make_run, differential, 0.5, duration_s=3.0)
    for _ in range(30):
        run.step()
    run.step(HOLD)
    for _ in range(100):
        run.step()
    assert not run.step(AUTO).state.mission_completed
    begin_ns = run.now_ns
    run.until(lambda out: out.state.mission_completed, 3.0)
    assert run.now_ns - begin_ns == pytest.approx(1.5e9, abs=0.15e9)


def test_what_a_robot_cannot_do_is_refused(robot):
    item = KeepDistanceItem("keep_distance", 0.12, 5.0)
    mission = Mission("keep", StartPose(0.0, 0.0), (item,))
    with pytest.raises(MissionError, match=r"distance_m = 0\.12 is never reached"):
        check_mission(mission, Abilities(robot.drive, frozenset({"front"}), GuardConfig(), BODY))
    far = replace(mission, item=(replace(item, distance_m=0.5),))
    with pytest.raises(MissionError, match="no sonar that looks to the front"):
        check_mission(far, Abilities(robot.drive, frozenset({"left"}), GuardConfig(), BODY))
