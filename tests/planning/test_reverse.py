"""AUTO and GUIDED in reverse: the robot leads with its rear, and arrives as it does ahead."""

import math
from dataclasses import replace

import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, PositionRequest, ReverseRequest
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from tests.planning.behave.journey.bench import START, Bench, room, two_rooms

AUTO, GUIDED, HOLD = (ModeRequest(mode) for mode in (Mode.AUTO, Mode.GUIDED, Mode.HOLD))
REVERSE, AHEAD = ReverseRequest(True), ReverseRequest(False)


def ways(run):
    """Return how far a run has driven ahead and back [m]."""
    ahead = back = 0.0
    for before, after in zip(run.trace, run.trace[1:], strict=False):
        way = (before.inverse() @ after).x_m
        ahead, back = ahead + max(way, 0.0), back + max(-way, 0.0)
    return ahead, back


def away(run, x, y):
    return math.dist((run.world.pose.x_m, run.world.pose.y_m), (x, y))


@pytest.mark.parametrize("heading_rad", [0.0, 3.0])
def test_a_place_is_driven_to_backwards_whatever_way_the_robot_looks(
    differential, make_run, heading_rad
):
    run = make_run(differential, start=SE2(1.5, 2.5, heading_rad))
    out = run.step(GUIDED, REVERSE, PositionRequest(4.0, 2.5))
    assert out.state.reverse
    run.until(lambda out: out.state.goal_reached is not None, 40.0)
    ahead, back = ways(run)
    assert away(run, 4.0, 2.5) < 0.06
    assert ahead < 0.02
    assert 2.4 < back < 2.7
    assert abs(wrap_angle(run.world.pose.theta_rad - math.pi)) < 0.2
    assert run.world.touched == 0


def test_any_robot_that_looks_back_drives_to_what_lies_behind_it_backwards(robot, make_run):
    run = make_run(robot, start=SE2(4.0, 2.5, 0.0))
    run.step(GUIDED, REVERSE, PositionRequest(1.5, 2.7))
    run.until(lambda out: out.state.goal_reached is not None, 40.0)
    assert away(run, 1.5, 2.7) < 0.06
    ahead, back = ways(run)
    assert ahead < 0.02
    assert back == pytest.approx(2.5, abs=0.1)


def test_a_mission_goes_backwards_along_its_path_and_ahead_again_when_it_is_asked_to(
    differential, make_run
):
    path = DriveItem("drive", ((1.0, 1.0), (4.0, 1.0), (4.0, 3.4)), 0.4)
    last = StraightToItem("straight_to", 2.0, 3.4)
    run = make_run(differential, mission=Mission("t", StartPose(1.0, 1.0), (path, last)))
    run.step(AUTO, REVERSE)
    run.until(lambda out: out.state.item == 1, 60.0)
    ahead, back = ways(run)
    assert ahead < 0.02
    assert back == pytest.approx(5.2, abs=0.2)
    run.step(AHEAD)
    run.until(lambda out: out.state.mission_completed, 40.0)
    assert away(run, 2.0, 3.4) < 0.06
    assert ways(run)[1] == pytest.approx(back, abs=0.1)
    assert run.world.touched == 0


def test_what_stands_behind_stops_it(differential, make_run):
    run = make_run(differential, start=SE2(4.0, 2.5, 0.0))
    run.step(GUIDED, REVERSE, PositionRequest(0.2, 1.0))  # beyond what the walls leave
    run.until(lambda out: "waiting" in out.state.message, 40.0)
    for _ in range(100):
        run.step()
    assert run.world.touched == 0


def test_another_mode_or_the_same_anew_drives_ahead(differential, make_run):
    run = make_run(differential)
    assert run.step(GUIDED, REVERSE).state.reverse
    assert not run.step(GUIDED).state.reverse
    assert run.step(REVERSE).state.reverse
    assert not run.step(HOLD).state.reverse
    out = run.step(REVERSE)
    assert not out.state.reverse
    assert "AUTO and GUIDED" in out.state.message


def test_a_robot_that_sees_nothing_behind_it_refuses(differential, make_run):
    mounts = tuple(mount for mount in differential.mounts if abs(mount.heading_deg) < 130.0)
    run = make_run(replace(differential, mounts=mounts))
    out = run.step(GUIDED, REVERSE)
    assert not out.state.reverse
    assert "no sonar looks back" in out.state.message


@pytest.mark.parametrize("with_map", [True, False])
@pytest.mark.parametrize("heading_rad", [None, math.pi / 2])
def test_a_way_that_is_planned_is_driven_backwards_through_a_door(with_map, heading_rad):
    world = two_rooms(0.8)
    bench = Bench(world, world if with_map else None)
    bench.pilot.use_reverse(reverse=True)
    driven = []
    end = bench.drive(5.0, 3.0, heading_rad, each=lambda each: driven.append(each.twist.v_m_s))
    assert end.status is Status.DONE
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (5.0, 3.0)) < 0.06
    assert max(driven) < 0.1
    if heading_rad is not None:
        assert abs(wrap_angle(bench.pose.theta_rad - heading_rad)) < 0.09
    assert bench.pilot.recoveries == 0


def test_a_journey_under_way_turns_round_when_it_is_asked_to():
    bench = Bench(room(8.0, 4.0), room(8.0, 4.0), start=START)
    driven = {True: 0.0, False: 0.0}

    def watch(bench):
        bench.pilot.use_reverse(reverse=bench.pose.x_m > 3.5 or bench.pilot.tools.paths.reverse)
        driven[bench.pilot.tools.paths.reverse] += bench.twist.v_m_s * 0.05

    assert bench.drive(7.0, 2.0, each=watch).status is Status.DONE
    assert driven[False] == pytest.approx(2.5, abs=0.1)
    assert driven[True] == pytest.approx(-3.5, abs=0.8)
