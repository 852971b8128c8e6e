"""The navigator's modes, driven in the simulated flat."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    HomeRequest,
    ModeRequest,
    PlaceRequest,
    PositionRequest,
    StickRequest,
    VelocityRequest,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.behaviours.turn_to import TurnToItem
from robotctl.planning.behave.behaviours.wait import WaitItem
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from robotctl.planning.navigation_step import NavigationInputs

LATER = 10**15
AUTO = ModeRequest(Mode.AUTO)
RTL = ModeRequest(Mode.RTL)
HOLD = ModeRequest(Mode.HOLD)
GUIDED = ModeRequest(Mode.GUIDED)
MANUAL = ModeRequest(Mode.MANUAL)


def mission(*items, x=1.0, y=1.0):
    return Mission("test", "flat", StartPose(x, y), items)


def ahead(x, speed=0.4):
    return DriveItem("drive", ((1.0, 1.0), (x, 1.0)), speed_m_s=speed, name="ahead")


def box(x0, y0, x1, y1):
    return np.array([(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)])


def home_distance(run):
    home = run.trace[0]
    return math.dist((run.world.pose.x_m, run.world.pose.y_m), (home.x_m, home.y_m))


def test_it_begins_in_hold_and_stands(robot, make_run):
    run = make_run(robot)
    out = run.step(VelocityRequest(LATER, 0.5, 0.0), StickRequest(LATER, 1.0, 0.0))
    assert out.state.mode is Mode.HOLD
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


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


def test_a_guided_velocity_is_driven_until_it_expires(robot, make_run):
    run = make_run(robot, flat=False)
    out = run.step(GUIDED, VelocityRequest(100_000_000, 0.3, 0.2))
    assert (out.v_m_s, out.omega_rad_s) == (0.3, 0.2)
    run.step()
    assert run.step().v_m_s == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_guided_velocity_that_is_no_number_stops(robot, make_run, bad):
    out = make_run(robot).step(GUIDED, VelocityRequest(LATER, bad, 0.0))
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


def test_a_guided_velocity_towards_a_wall_stops_ahead_of_it(robot, make_run):
    for v, start in ((0.8, SE2(1.5, 1.0, 0.0)), (-0.6, SE2(3.0, 1.0, 0.0))):
        run = make_run(robot, start=start, range_noise_m=0.01, outliers=0.01)
        run.step(GUIDED, VelocityRequest(LATER, v, 0.0))
        for _ in range(200):
            out = run.step()
        assert abs(run.world.twist.v_m_s) < 0.05
        assert run.world.touched == 0
        assert out.v_m_s == 0.0
        assert "waiting" in out.state.message


@pytest.mark.parametrize(
    "goal", [(2.0, 0.0), (1.0, 1.0), (-2.0, 0.3), (0.0, 0.4), (0.3, -0.3), (-0.3, 0.1)]
)
def test_a_guided_position_is_reached_from_any_side(robot, make_run, goal):
    run = make_run(robot, flat=False)
    run.step(GUIDED, PositionRequest(*goal))
    speeds = []
    run.until(lambda out: speeds.append(out.v_m_s) or out.v_m_s == out.omega_rad_s == 0.0, 60.0)
    assert math.dist((run.world.pose.x_m, run.world.pose.y_m), goal) < 0.07
    assert run.world.distance_m < 8.0
    gears = [v > 0 for v in speeds if v != 0.0]
    assert sum(a != b for a, b in itertools.pairwise(gears)) <= 1


def test_a_new_position_replaces_the_old_and_a_velocity_ends_it(differential, make_run):
    run = make_run(differential, flat=False)
    run.step(GUIDED, PositionRequest(5.0, 0.0))
    run.until(lambda out: run.world.pose.x_m > 1.0, 10.0)
    run.step(PositionRequest(1.0, 1.0))
    run.until(lambda out: out.v_m_s == out.omega_rad_s == 0.0, 20.0)
    assert run.world.pose.y_m == pytest.approx(1.0, abs=0.06)
    run.step(PositionRequest(5.0, 0.0))
    out = run.step(VelocityRequest(LATER, -0.2, 0.0))
    assert out.v_m_s == -0.2


def test_before_a_wall_a_robot_that_turns_on_the_spot_turns_away(differential, make_run):
    run = make_run(differential, start=SE2(4.0, 1.0, 0.0))
    run.step(GUIDED, VelocityRequest(LATER, 0.4, 0.0))
    run.until(lambda out: "waiting" in out.state.message, 20.0)
    before = run.world.pose
    out = run.step(VelocityRequest(LATER, 0.4, 0.5))
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.5)
    run.until(lambda out: out.v_m_s > 0.1, 10.0)  # away from the wall it drives again
    assert run.world.pose.x_m - before.x_m < 0.1
    assert run.world.touched == 0


def test_a_drive_and_steer_robot_before_a_wall_stands(steered, make_run):
    run = make_run(steered, start=SE2(4.0, 1.0, 0.0))
    run.step(GUIDED, VelocityRequest(LATER, 0.4, 0.5))
    out = run.until(lambda out: "waiting" in out.state.message, 20.0)
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


def test_a_robot_that_cannot_turn_on_the_spot_says_so(steered, make_run):
    out = make_run(steered).step(GUIDED, VelocityRequest(LATER, 0.0, 0.5))
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)
    assert out.state.message == "this robot cannot turn on the spot"


@pytest.mark.parametrize("direction_deg", [0.0, 45.0, 90.0, -135.0, 179.0])
def test_a_robot_told_once_to_drive_in_a_direction_turns_to_it_and_drives_along_it(
    robot, make_run, direction_deg
):
    speed = 0.3
    run = make_run(robot, flat=False, start=SE2(0.0, 0.0, 0.0))
    direction = math.radians(direction_deg)
    wish = VelocityRequest(30_000_000_000, speed, 0.0, direction)
    out = run.step(GUIDED, wish)
    turned = [0.0]
    while run.now_ns < 29_000_000_000:
        before = run.world.pose.theta_rad
        out = run.step()
        step_rad = math.remainder(run.world.pose.theta_rad - before, math.tau)
        turned.append(turned[-1] + step_rad)
    assert math.remainder(run.world.pose.theta_rad - direction, math.tau) == pytest.approx(
        0.0, abs=0.02
    )
    assert max(map(abs, turned)) < abs(direction) + 0.2  # the short way, and not round again
    assert out.v_m_s == pytest.approx(speed, rel=0.01)
    run.until(lambda out: out.v_m_s == 0.0, 2.0)  # void at its time


def test_facing_away_it_turns_on_the_spot_and_a_drive_and_steer_robot_in_a_slow_bend(
    robot, make_run
):
    out = make_run(robot, flat=False).step(GUIDED, VelocityRequest(LATER, 0.5, 0.0, 2.5))
    assert out.v_m_s == pytest.approx(0.15 if robot.drive.steered else 0.0)
    assert out.omega_rad_s > 0.0


def test_a_direction_means_nothing_once_the_place_is_lost(differential, make_run):
    run = make_run(differential, flat=False)
    assert run.step(GUIDED, VelocityRequest(LATER, 0.3, 0.0, 0.0)).v_m_s > 0.0
    for localised in (False, True):  # nor does one of before when it is found
        inputs = NavigationInputs(
            run.world.odometry,
            run.world.twist,
            run.world.ranges(),
            (run.now_ns,) * len(differential.mounts),
            enabled=True,
            localised=localised,
        )
        out = run.navigator.step(inputs, run.now_ns)
        assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


def test_auto_without_a_mission_is_refused_with_the_reason(robot, make_run):
    run = make_run(robot)
    out = run.step(AUTO)
    assert out.state.mode is Mode.HOLD
    assert "no mission is loaded" in out.state.message
    assert run.navigator.refusal(Mode.AUTO)
    assert not run.navigator.refusal(Mode.RTL)


def test_a_mission_that_the_robot_cannot_drive_is_refused_at_once(steered, make_run):
    with pytest.raises(MissionError, match="item 1"):
        make_run(steered, mission=mission(TurnToItem("turn_to", 90.0)))


def test_items_run_in_their_order(differential, make_run):
    plan = mission(WaitItem("wait", 1.0), TurnToItem("turn_to", 90.0), ahead(2.0))
    run = make_run(differential, mission=plan)
    run.step(AUTO)
    run.until(lambda out: out.state.item == 1, 1.2)
    out = run.until(lambda out: out.state.item == 2, 5.0)
    assert run.world.pose.theta_rad == pytest.approx(math.pi / 2, abs=0.06)
    assert out.state.item_name == "ahead"
    out = run.until(lambda out: out.state.mission_completed, 20.0)
    assert (out.state.item, out.state.items, out.state.item_name) == (3, 3, "")
    assert run.world.pose.x_m == pytest.approx(2.0, abs=0.07)


def test_while_not_armed_nothing_moves_and_no_time_passes(robot, make_run):
    run = make_run(robot, mission=mission(WaitItem("wait", 1.0), ahead(2.0)))
    run.enabled = False
    run.step(AUTO)
    for _ in range(100):
        out = run.step()
        assert (out.v_m_s, out.state.item) == (0.0, 0)
    run.enabled = True
    run.until(lambda out: out.state.item == 1, 1.2)


def test_an_interrupted_mission_goes_on_where_it_was_left(robot, make_run):
    run = make_run(robot, mission=mission(WaitItem("wait", 0.5), ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    out = run.step(HOLD)
    assert (out.v_m_s, out.state.item) == (0.0, 1)
    run.step(MANUAL, StickRequest(LATER, 0.3, 0.0))
    for _ in range(20):
        run.step()
    before = run.now_ns
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 10.0)
    assert (run.now_ns - before) / 1e9 < 6.0
    assert min(pose.x_m for pose in run.trace[-40:]) > 2.0


@pytest.mark.parametrize("other", [HOLD, MANUAL], ids=["hold", "manual"])
def test_time_in_another_mode_is_no_time_of_the_item(robot, make_run, other):
    way = StraightToItem("straight_to", 4.0, 1.0, name="away", time_out_s=30.0)
    run = make_run(robot, mission=mission(WaitItem("wait", 20.0), way))

    def drive_a_second_and_pause_for_40():
        for _ in range(20):
            run.step()
        run.step(other)
        for _ in range(20 * 40):
            run.step()
        run.step(AUTO)

    run.step(AUTO)
    drive_a_second_and_pause_for_40()
    began_ns = run.now_ns
    run.until(lambda out: out.state.item == 1, 25.0)
    assert run.now_ns - began_ns == pytest.approx(19e9, abs=0.2e9)
    drive_a_second_and_pause_for_40()
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 29.0)
    assert out.state.mission_completed, out.state.message


@pytest.mark.parametrize("mode", [AUTO, RTL])
def test_armed_again_after_a_stop_the_robot_does_not_drive_on_by_itself(robot, make_run, mode):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    run.step(mode)
    run.enabled = False
    assert run.step().v_m_s == 0.0
    run.enabled = True
    for _ in range(40):
        out = run.step()
        assert (out.v_m_s, out.omega_rad_s, out.state.mode) == (0.0, 0.0, Mode.HOLD)
    assert out.state.message == "hold: the robot was stopped"
    assert out.state.held
    assert not run.step(AUTO).state.held
    run.until(lambda out: out.state.mission_completed, 10.0)


def test_without_a_known_way_home_rtl_is_refused_with_the_reason(robot, make_run):
    run = make_run(robot)
    run.step()
    there = run.world.odometry
    run.world.odometry = SE2(there.x_m + 1.5, there.y_m, there.theta_rad)  # found elsewhere
    run.step()
    out = run.step(RTL)
    assert (out.state.mode, out.v_m_s) == (Mode.HOLD, 0.0)
    assert "the path home is not known" in out.state.message


def test_a_target_of_before_the_stop_is_forgotten(robot, make_run):
    run = make_run(robot, flat=False)
    run.step(GUIDED, PositionRequest(3.0, 0.0))
    run.until(lambda out: run.world.pose.x_m > 1.0, 10.0)
    run.enabled = False
    run.step()
    run.enabled = True
    run.step(GUIDED)
    for _ in range(40):
        assert run.step().v_m_s == 0.0


def test_a_place_is_refused_by_a_robot_that_knows_none(differential, make_run):
    run = make_run(differential, flat=False)
    out = run.step(GUIDED, PlaceRequest("kitchen"))
    assert out.state.message.startswith(
        "refused: this robot knows no places: navigation.pilot.topology"
    )
    assert out.state.goals == 0
    assert run.step(PositionRequest(3.0, 0.0)).v_m_s > 0.0


def test_a_position_sent_while_not_armed_is_not_driven_to_when_armed(robot, make_run):
    run = make_run(robot, flat=False)
    run.enabled = False
    run.step(GUIDED, PositionRequest(3.0, 0.0))
    run.step(PositionRequest(3.0, 0.0))
    run.enabled = True
    for _ in range(40):
        out = run.step()
        assert (out.v_m_s, out.omega_rad_s, out.state.mode) == (0.0, 0.0, Mode.GUIDED)
    assert run.step(PositionRequest(3.0, 0.0)).v_m_s > 0.0


def test_sticks_steer_again_as_soon_as_the_robot_is_armed_again(differential, make_run):
    run = make_run(differential)
    run.step(MANUAL, StickRequest(LATER, 0.5, 0.0))
    run.enabled = False
    assert run.step().v_m_s == 0.0
    run.enabled = True
    assert run.step(StickRequest(LATER, 0.5, 0.0)).v_m_s > 0.0


@pytest.mark.parametrize("gap_s", [0.4, 0.55, 4.8])
def test_a_navigator_held_up_for_seconds_stands_and_goes_on(robot, make_run, gap_s):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    run.now_ns += round(gap_s * 1e9)
    steps = [run.step() for _ in range(40)]
    assert {each.state.mode for each in steps} == {Mode.AUTO}
    stands = [each.v_m_s == 0.0 for each in steps]
    if gap_s < 0.5:
        assert not any(stands)
    else:
        waited = sum(stands)
        assert 15 <= waited <= 22  # a second of steps in time
        assert all(stands[:waited])
        assert f"held up (a step took that long) for {gap_s + 0.05:.1f}" in steps[0].state.message


def test_a_navigator_held_up_for_longer_holds(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: run.world.pose.x_m > 2.0, 10.0)
    run.now_ns += 5_100_000_000
    for _ in range(60):
        out = run.step()
        assert (out.v_m_s, out.state.mode) == (0.0, Mode.HOLD)
    assert out.state.message.startswith("hold: navigation was held up")
    assert run.step(AUTO).v_m_s > 0.0


def test_asking_for_auto_again_repeats_a_completed_mission(differential, make_run):
    run = make_run(differential, mission=mission(WaitItem("wait", 0.2)))
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 1.0)
    assert run.step().state.mission_completed
    assert not run.step(AUTO).state.mission_completed
    run.until(lambda out: out.state.mission_completed, 1.0)


def test_the_robot_waits_for_an_obstacle_and_goes_on_when_it_is_gone(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.world.obstacle = box(2.8, 0.8, 3.0, 1.2)
    run.step(AUTO)
    out = run.until(lambda out: "waiting" in out.state.message, 15.0)
    assert "front measures" in out.state.message
    for _ in range(60):
        out = run.step()
    assert run.world.twist.v_m_s == 0.0
    run.world.obstacle = None
    run.until(lambda out: out.state.mission_completed, 15.0)
    assert run.world.touched == 0


def test_a_robot_blocked_for_too_long_gives_up_with_the_reason_and_can_go_on_later(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.world.obstacle = box(2.8, 0.8, 3.0, 1.2)
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 30.0)
    assert 'item 1 "ahead" (drive): blocked for 10 s: front measures' in out.state.message
    assert not out.state.mission_completed
    assert run.step().v_m_s == 0.0
    run.world.obstacle = None
    run.step(HOLD)
    assert not run.step(AUTO).state.mission_failed
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 30.0)
    assert out.state.mission_completed, out.state.message


def test_each_time_the_way_is_blocked_the_patience_begins_anew(robot, make_run):
    run = make_run(robot, mission=mission(ahead(4.0)))
    for x in (2.2, 3.2):
        run.world.obstacle = box(x, 0.8, x + 0.2, 1.2)
        out = run.step(AUTO) if x < 3.0 else run.step()
        run.until(lambda out: "waiting" in out.state.message, 15.0)
        for _ in range(140):  # 7 of 10 seconds
            out = run.step()
        assert not out.state.mission_failed
        run.world.obstacle = None
    run.until(lambda out: out.state.mission_completed, 15.0)


def test_an_item_over_its_time_fails_with_the_reason(robot, make_run):
    item = DriveItem("drive", ((1.0, 1.0), (4.0, 1.0)), time_out_s=2.0)
    run = make_run(robot, mission=mission(item))
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 3.0)
    assert "not done after 2 s" in out.state.message


def test_a_robot_far_from_its_path_gives_up(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)), start=SE2(1.0, 2.0, 0.0))
    out = run.step(AUTO)
    assert out.state.mission_failed
    assert "1.00 m off the path" in out.state.message
    assert out.v_m_s == 0.0


def test_home_moves_to_where_the_robot_is_and_rtl_leads_there(robot, make_run):
    run = make_run(robot, mission=mission(ahead(1.5), ahead(3.5)))
    assert run.step(AUTO).state.home is None
    run.until(lambda out: out.state.item == 1, 20.0)
    there = run.world.pose
    out = run.step(HomeRequest(there.x_m, there.y_m, there.theta_rad))
    assert out.state.home == (there.x_m, there.y_m, there.theta_rad)
    run.until(lambda out: out.state.mission_completed, 20.0)
    run.step(RTL)
    run.until(lambda out: out.state.message == "home", 60.0)
    run.step(HomeRequest(0.0, 0.0, 0.0))
    assert "not moved while the robot drives there" in run.messages[-1]
    here = run.world.pose
    assert math.hypot(here.x_m - there.x_m, here.y_m - there.y_m) < 0.2


def test_home_elsewhere_leaves_the_way_there_unknown_until_the_robot_is_there(robot, make_run):
    run = make_run(robot)
    run.step(HomeRequest(5.0, 1.0, 0.0))
    out = run.step(RTL)
    assert out.state.mode is Mode.HOLD
    assert "the path home is not known" in out.state.message
    assert run.step(HomeRequest(math.nan, 1.0, 0.0)).state.home == (5.0, 1.0, 0.0)


def test_the_way_home_leads_back_through_the_door(robot, make_run):
    way = DriveItem(
        "drive", ((1.0, 1.0), (4.0, 1.0), (4.0, 2.5), (6.5, 2.5), (6.5, 4.0)), corner_radius_m=0.6
    )
    run = make_run(robot, mission=mission(way), drift=0.003, range_noise_m=0.01)
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 60.0)
    run.step(RTL)
    out = run.until(lambda out: out.state.message == "home", 90.0)
    assert out.v_m_s == 0.0
    assert run.world.touched == 0
    assert home_distance(run) < 0.25  # breadcrumbs 0.1 m apart, and the odometry's drift


def test_drive_and_steer_robots_return_in_reverse_gear_and_others_forwards(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.0)))
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 20.0)
    run.step(RTL)
    speeds = []
    while (out := run.step()).state.message != "home":
        speeds.append(out.v_m_s)
        assert len(speeds) < 1000
    assert min(speeds) < 0 if robot.drive.steered else min(speeds) >= 0.0
    assert max(speeds) <= 0 if robot.drive.steered else max(speeds) > 0.0
    assert home_distance(run) < 0.15


def test_an_interrupted_way_home_goes_on(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)))
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 20.0)
    run.step(RTL)
    run.until(lambda out: run.world.pose.x_m < 2.5, 20.0)
    run.step(HOLD)
    for _ in range(10):
        run.step()
    run.step(RTL)
    before = run.world.distance_m
    run.until(lambda out: out.state.message == "home", 20.0)
    assert home_distance(run) < 0.15
    assert run.world.distance_m - before < 1.8


def test_ways_with_changes_of_gear_are_driven_back(steered, make_run):
    run = make_run(steered, flat=False)
    for v, omega in ((0.4, 0.3), (-0.4, 0.4), (0.4, 0.3)):
        run.step(GUIDED, VelocityRequest(run.now_ns + 5_000_000_000, v, omega))
        for _ in range(100):
            run.step()
    assert home_distance(run) > 1.0
    run.step(RTL)
    run.until(lambda out: out.state.message == "home", 60.0)
    assert home_distance(run) < 0.15


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e308])
def test_an_invalid_pose_or_velocity_stops_the_robot(robot, make_run, bad):
    run = make_run(robot, mission=mission(ahead(3.0)))
    run.step(AUTO)
    ranges = (math.inf,) * 8
    for pose, twist in (
        (SE2(bad, 1.0, 0.0), Twist(0.1, 0.0)),
        (SE2(1.0, -bad, 0.0), Twist(0.1, 0.0)),
        (SE2(1.0, 1.0, 0.0), Twist(math.nan, 0.0)),
    ):
        out = run.navigator.step(
            NavigationInputs(pose, twist, ranges, (run.now_ns,) * 8, True), run.now_ns
        )
        assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)
        assert "no valid pose" in out.state.message
    run.until(lambda out: out.state.mission_completed, 20.0)


@pytest.mark.parametrize("ranges", [(), (1.0,), (math.nan,) * 8])
def test_without_readings_of_its_sonars_the_robot_stands(robot, make_run, ranges):
    run = make_run(robot, mission=mission(ahead(3.0)))
    inputs = NavigationInputs(run.world.pose, Twist(0.0, 0.0), ranges, (0,) * 8, True, (AUTO,))
    out = run.navigator.step(inputs, 0)
    assert out.v_m_s == 0.0
    assert "gives no reading" in out.state.message


def test_recorded_inputs_give_the_same_outputs_bit_for_bit(robot, make_run):
    plan = mission(ahead(3.0), WaitItem("wait", 0.5))
    run = make_run(robot, mission=plan, drift=0.01, range_noise_m=0.02, outliers=0.02)
    recorded, step = [], run.navigator.step

    def recording(inputs, now_ns):
        recorded.append((inputs, now_ns, out := step(inputs, now_ns)))
        return out

    run.navigator.step = recording
    run.step(AUTO)
    run.until(lambda out: out.state.mission_completed, 20.0)
    run.step(RTL)
    run.until(lambda out: out.state.message == "home", 30.0)
    replayed = make_run(robot, mission=plan).navigator
    assert len(recorded) > 100
    assert all(replayed.step(inputs, now) == out for inputs, now, out in recorded)


def test_before_the_first_pose_no_breadcrumb_is_dropped(robot, make_run):
    run = make_run(robot, mission=mission(ahead(2.5)))
    unknown = NavigationInputs(
        SE2(math.nan, math.nan, math.nan), Twist(0.0, 0.0), (), (), False, (AUTO,)
    )
    assert "no valid pose" in run.navigator.step(unknown, 0).state.message
    run.until(lambda out: out.state.mission_completed, 20.0)
    before = run.world.distance_m
    run.step(RTL)
    run.until(lambda out: out.state.message == "home", 20.0)
    assert run.world.distance_m - before == pytest.approx(1.4, abs=0.25)


def test_a_point_beside_is_given_up_where_no_sonar_looks_back(steered, make_run):
    ahead_only = tuple(mount for mount in steered.mounts if "rear" not in mount.name)
    run = make_run(replace(steered, mounts=ahead_only), flat=False)
    run.step(GUIDED)
    for _ in range(40):
        out = run.step(PositionRequest(0.1, 0.25)) if run.now_ns < 1e8 else run.step()
        assert out.v_m_s == 0.0
    assert out.state.message == "0.3 m to go, too close beside: backing up needs a rear sonar"


def test_a_point_beside_is_reached_by_backing_up_where_a_sonar_looks_back(steered, make_run):
    run = make_run(steered, flat=False)
    run.step(GUIDED)
    out = run.step(PositionRequest(0.1, 0.25))
    assert out.v_m_s < 0.0
    assert "backing up" in out.state.message
    run.until(lambda out: out.state.message == "arrived", 30.0)
