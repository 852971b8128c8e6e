"""RTL: the way home."""

import math

from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    HomeRequest,
    VelocityRequest,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from tests.planning.bench import AUTO, GUIDED, HOLD, RTL, ahead, mission


def home_distance(run):
    home = run.trace[0]
    return math.dist((run.world.pose.x_m, run.world.pose.y_m), (home.x_m, home.y_m))


def test_without_a_known_way_home_rtl_is_refused_with_the_reason(robot, make_run):
    run = make_run(robot)
    run.step()
    there = run.world.odometry
    run.world.odometry = SE2(there.x_m + 1.5, there.y_m, there.theta_rad)  # found elsewhere
    run.step()
    out = run.step(RTL)
    assert (out.state.mode, out.v_m_s) == (Mode.HOLD, 0.0)
    assert "the path home is not known" in out.state.message


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
