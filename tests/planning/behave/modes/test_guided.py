"""GUIDED: velocities, directions and positions."""

import itertools
import math

import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    PlaceRequest,
    PositionRequest,
    VelocityRequest,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.navigation_step import NavigationInputs
from tests.planning.bench import GUIDED, LATER


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
