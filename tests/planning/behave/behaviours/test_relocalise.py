"""A robot that does not know where it is: what it does, and what it leaves alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    ModeRequest,
    PositionRequest,
    StickRequest,
    VelocityRequest,
)
from robotctl.model.drives.drives import TricycleDrive
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput
from robotctl.planning.behave.behaviours.relocalise import LookAround
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.navigation_step import NavigationInputs

PLACES = (SE2(1.0, 1.0, 0.0), SE2(2.5, 3.0, 2.0), SE2(6.5, 3.5, -1.0), SE2(4.0, 2.5, 0.0))
MISSION = {
    "name": "there",
    "world": "flat",
    "start": {"x_m": 1.0, "y_m": 1.0},
    "item": [{"kind": "straight_to", "x_m": 3.0, "y_m": 1.0}],
}


@pytest.fixture
def mission(make_mission):
    """Return a mission of one point."""
    return make_mission(MISSION)


@pytest.fixture
def make_mission(tmp_path):
    from robotctl import toml_source

    def make(data):
        start, item = data["start"], data["item"][0]
        text = (
            f'name = "{data["name"]}"\nworld = "{data["world"]}"\n'
            f"start = {{ x_m = {start['x_m']}, y_m = {start['y_m']} }}\n"
            f'[[item]]\nkind = "straight_to"\nx_m = {item["x_m"]}\ny_m = {item["y_m"]}\n'
        )
        return toml_source.parse(text, Mission, "mission")

    return make


def lost_step(run, *requests):
    """Step a navigator that is told nothing of where it is but the odometry, far off."""
    world = run.world
    far = SE2(world.odometry.x_m + 50.0, world.odometry.y_m, world.odometry.theta_rad)
    inputs = NavigationInputs(
        far,
        world.twist,
        world.ranges(),
        (run.now_ns,) * len(world.robot.mounts),
        run.enabled,
        requests,
        localised=False,
    )
    out = run.navigator.step(inputs, run.now_ns)
    for _ in range(5):
        world.drive(out.v_m_s, out.omega_rad_s, 0.01)
    world.check_contact()
    run.trace.append(world.pose)
    run.now_ns += 50_000_000
    return out


@pytest.mark.parametrize(("seed", "place"), list(enumerate(PLACES)))
def test_it_moves_through_the_room_without_touching_anything(make_run, robot, place, seed, mission):
    run = make_run(robot, start=place, mission=mission, seed=seed, range_noise_m=0.01)
    lost_step(run, ModeRequest(Mode.AUTO))
    for _ in range(20 * 60):
        lost_step(run)
    assert run.world.touched == 0
    assert run.world.distance_m > 3.0
    spread = {(round(pose.x_m), round(pose.y_m)) for pose in run.trace}
    assert len(spread) >= 3


def test_a_robot_that_can_turns_once_round_before_it_drives(make_run, differential, mission):
    run = make_run(differential, start=SE2(2.5, 2.5, 0.3), mission=mission)
    lost_step(run, ModeRequest(Mode.AUTO))
    turned, before = 0.0, run.world.pose.theta_rad
    while run.world.distance_m == 0.0:
        lost_step(run)
        turned += math.remainder(run.world.pose.theta_rad - before, math.tau)
        before = run.world.pose.theta_rad
        assert turned < 7.0
    assert turned == pytest.approx(math.tau, abs=0.1)


def test_once_it_knows_its_place_it_does_what_it_was_told(make_run, differential, mission):
    run = make_run(differential, mission=mission)
    lost_step(run, ModeRequest(Mode.AUTO))
    for _ in range(100):
        lost_step(run)
    out = run.until(lambda out: out.state.mission_completed, 60.0)
    assert out.state.mission_completed
    assert math.hypot(run.world.pose.x_m - 3.0, run.world.pose.y_m - 1.0) < 0.1


def test_no_item_of_the_mission_is_worked_on_meanwhile(make_run, differential, mission):
    run = make_run(differential, mission=mission)
    out = lost_step(run, ModeRequest(Mode.AUTO))
    for _ in range(2000):
        out = lost_step(run)
    assert (out.state.item, out.state.mission_failed) == (0, False)
    assert "looking" in out.state.message or "turning" in out.state.message


def test_a_position_of_the_ground_station_has_to_wait_too(make_run, differential):
    run = make_run(differential, start=SE2(2.5, 2.5, 0.0))
    lost_step(run, ModeRequest(Mode.GUIDED))
    out = lost_step(run, PositionRequest(4.0, 2.5))
    assert (out.v_m_s, out.state.message) == (0.0, "looking around")
    assert out.omega_rad_s != 0.0


@pytest.mark.parametrize(
    ("mode", "request_"),
    [
        (Mode.GUIDED, VelocityRequest(10_000_000_000, 0.1, 0.3)),
        (Mode.MANUAL, StickRequest(10_000_000_000, 0.125, 0.12)),
    ],
)
def test_velocities_and_sticks_need_no_place(make_run, differential, mode, request_):
    run = make_run(differential, start=SE2(2.5, 2.5, 0.0))
    lost_step(run, ModeRequest(mode))
    out = lost_step(run, request_)
    assert (out.v_m_s, out.omega_rad_s) == pytest.approx((0.1, 0.3))


def test_held_it_stands(make_run, differential):
    run = make_run(differential)
    for _ in range(10):
        out = lost_step(run)
        assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)


def test_no_breadcrumb_is_dropped_at_a_guess(make_run, differential):
    run = make_run(differential, start=SE2(1.0, 1.0, 0.0))
    for _ in range(20):
        lost_step(run)
    run.step(ModeRequest(Mode.RTL))
    out = run.step()
    assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)  # it stands at home


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_a_robot_that_has_done_what_it_was_told_does_not_set_off(make_run, robot, mode):
    item = StraightToItem("straight_to", 2.5, 1.0)
    run = make_run(robot, mission=Mission("out", StartPose(1.0, 1.0), (item,)))
    run.step(ModeRequest(Mode.AUTO))
    run.until(lambda out: out.state.mission_completed, 30.0)
    if mode is Mode.RTL:
        run.step(ModeRequest(mode))
        run.until(lambda out: out.state.message == "home", 30.0)
    elif mode is Mode.GUIDED:
        run.step(ModeRequest(mode))
        run.step(PositionRequest(3.0, 1.0))
        run.until(lambda out: out.state.message == "arrived", 30.0)
    for _ in range(100):
        out = lost_step(run)
        assert (out.v_m_s, out.omega_rad_s, out.state.mode) == (0.0, 0.0, mode)


def test_a_robot_whose_mission_has_failed_does_not_set_off(make_run, differential, mission):
    run = make_run(differential, mission=mission)
    run.world.obstacle = run.world.walls[:1] * 0.0 + [2.0, 0.5, 2.0, 1.5]
    run.step(ModeRequest(Mode.AUTO))
    run.until(lambda out: out.state.mission_failed, 60.0)
    for _ in range(100):
        out = lost_step(run)
        assert (out.v_m_s, out.omega_rad_s, out.state.mode) == (0.0, 0.0, Mode.AUTO)


def driven_out(make_run, robot):
    """Return a run of 2.5 m straight on, back on the way home, which has lost its place there."""
    item = StraightToItem("straight_to", 3.5, 1.0)
    run = make_run(robot, mission=Mission("out", StartPose(1.0, 1.0), (item,)))
    run.step(ModeRequest(Mode.AUTO))
    run.until(lambda out: out.state.mission_completed, 30.0)
    run.step(ModeRequest(Mode.RTL))
    run.until(lambda out: run.world.pose.x_m < 3.0, 20.0)
    for _ in range(40):  # half a metre at most
        out = lost_step(run)
        assert out.state.mode is Mode.RTL
    return run


def test_the_way_home_goes_on_behind_a_search(make_run, robot):
    run = driven_out(make_run, robot)
    out = run.until(lambda out: out.v_m_s == 0.0 and out.state.message in {"home", "hold"}, 60.0)
    assert (out.state.mode, out.state.message) == (Mode.RTL, "home")
    assert math.hypot(run.world.pose.x_m - 1.0, run.world.pose.y_m - 1.0) < 0.2
    assert run.world.touched == 0


def test_from_a_place_with_no_known_way_home_none_is_driven_behind_a_search(make_run, robot):
    run = driven_out(make_run, robot)
    run.world.pose = run.world.odometry = SE2(6.5, 3.5, 0.0)  # somebody has carried it
    lost_step(run)
    for _ in range(3):
        out = run.step()
        assert (out.v_m_s, out.omega_rad_s, out.state.mode) == (0.0, 0.0, Mode.HOLD)
    assert out.state.message.startswith("hold: the path home is not known")


def test_who_does_not_know_the_place_does_not_say_that_it_is_home(make_run, differential):
    run = make_run(differential, start=SE2(1.0, 1.0, 0.0))
    run.world.pose = run.world.odometry = SE2(3.0, 1.0, 0.0)
    lost_step(run)
    out = run.step(ModeRequest(Mode.RTL))
    assert (out.v_m_s, out.state.mode) == (0.0, Mode.HOLD)
    assert out.state.message.startswith("refused: the path home is not known")


def test_blind_sonars_make_it_stand_once_it_has_turned(make_run, differential, mission):
    run = make_run(differential, start=SE2(2.5, 2.5, 0.0), mission=mission)
    silent = (math.nan,) * 8
    requests = (ModeRequest(Mode.AUTO),)
    for _ in range(20 * 60):
        inputs = NavigationInputs(
            run.world.odometry,
            Twist(0.0, 0.0),
            silent,
            (run.now_ns,) * 8,
            True,
            requests,
            localised=False,
        )
        out = run.navigator.step(inputs, run.now_ns)
        run.now_ns += 50_000_000
        requests = ()
        assert out.v_m_s == 0.0
        run.world.drive(out.v_m_s, out.omega_rad_s, 0.05)


def only(robot, *names):
    """Return a robot with these sonars alone."""
    return replace(robot, mounts=tuple(mount for mount in robot.mounts if mount.name in names))


def test_without_a_sonar_that_looks_ahead_it_does_not_drive_and_says_so(make_run, robot, mission):
    blind = only(robot, "front_left", "left", "right", "rear")
    run = make_run(blind, start=SE2(2.5, 2.5, 0.0), mission=mission)
    out = lost_step(run, ModeRequest(Mode.AUTO))
    for _ in range(20 * 20):
        out = lost_step(run)
        assert out.v_m_s == 0.0
    assert (out.omega_rad_s, out.state.message) == (0.0, "no sonar looks ahead")


def test_without_a_sonar_that_looks_back_it_does_not_back_up_and_says_so(
    make_run, steered, mission
):
    blind = only(steered, "front", "front_left", "left", "right", "front_right")
    run = make_run(blind, start=SE2(7.2, 3.0, 0.0), mission=mission)
    out = lost_step(run, ModeRequest(Mode.AUTO))
    for _ in range(20 * 10):
        out = lost_step(run)
        assert out.v_m_s >= 0.0
    assert run.world.twist.v_m_s == pytest.approx(0.0, abs=0.01)
    assert out.state.message == "the path is blocked, and there is no rear sonar"
    assert run.world.touched == 0


@pytest.mark.parametrize(
    ("width_m", "heading_deg"),
    [(1.0, 0.0), (1.0, 10.0), (1.0, 25.0), (1.0, 60.0), (1.0, 90.0), (1.4, 10.0), (1.4, 60.0)],
)
@pytest.mark.parametrize("full_lock", [False, True])
def test_in_a_corridor_neither_nose_nor_tail_swings_into_a_wall(
    make_run, steered, mission, heading_deg, width_m, full_lock
):
    if full_lock:  # a turning radius of 0.25 m, about the length of the robot
        tight = TricycleDrive("tricycle", "front", 0.32, 0.06, 0.9, 4.0, 2400)
        steered = replace(steered, drive=tight)
    start = SE2(1.0, 0.5 * width_m, math.radians(heading_deg))
    run = make_run(steered, start=start, mission=mission, most_incidence_deg=35.0)
    run.world.walls = np.array(
        [(0, 0, 8, 0), (8, 0, 8, width_m), (8, width_m, 0, width_m), (0, width_m, 0, 0)]
    )
    lost_step(run, ModeRequest(Mode.AUTO))
    for _ in range(20 * 25):
        lost_step(run)
    assert run.world.touched == 0


def test_an_arm_that_stands_out_is_not_turned_into_the_jamb_of_a_door(differential):
    """In the door the arm passes one way round only so far, and then the other way."""
    body = Footprint(((0.2, -0.45), (0.2, 0.17), (-0.16, 0.17), (-0.16, -0.17), (0.05, -0.45)))
    guard = ObstacleGuard(GuardConfig(), (), has_lidar=True, outline=body)
    jambs = [(x, y) for x in np.arange(-0.2, -0.09, 0.01) for y in (0.48, -0.52)]
    search, pose, text = LookAround(differential.drive, guard, (), 0.2), SE2(0.0, 0.0, 1.95), ""
    shape, headings = shapely.Polygon(body.corners), [pose.theta_rad]
    while text != "no sonar looks ahead":
        around = np.array([pose.inverse().apply(*point) for point in jambs])
        guard.observe((), (), points_base=around)
        out = search.step(BehaviourInput(pose, Twist(0.0, 0.0), (), ()))
        assert out.v_m_s == 0.0
        text = out.text
        pose = SE2(0.0, 0.0, pose.theta_rad + 0.05 * out.omega_rad_s)
        headings.append(pose.theta_rad)
        turned = shapely.affinity.rotate(shape, pose.theta_rad, (0, 0), use_radians=True)
        assert all(turned.distance(shapely.Point(point)) > 0.02 for point in jambs)
        assert len(headings) < 500
    assert max(headings) > headings[0] + 0.2
    assert min(headings) < headings[0] - 1.0
