"""Following walls in the simulated flat."""

import math

import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.behaviours.follow_wall import FollowWall, FollowWallItem, Until
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from robotctl.planning.config import WallConfig


def follow(make_run, robot, start, item, **world):
    plan = Mission("wall", StartPose(start.x_m, start.y_m), (item,))
    run = make_run(robot, mission=plan, start=start, **world)
    run.step(ModeRequest(Mode.AUTO))
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, 60.0)
    return run, out


@pytest.mark.parametrize("offset", [-0.2, 0.0, 0.25])
def test_the_distance_converges_on_either_side(robot, make_run, offset):
    for side, start in (
        ("right", SE2(1.0, 0.8 + offset, 0.0)),
        ("left", SE2(4.0, 0.8 + offset, math.pi)),
    ):
        item = FollowWallItem("follow_wall", side, 0.8, Until(length_m=2.6))
        run, out = follow(make_run, robot, start, item, range_noise_m=0.01)
        assert out.state.mission_completed, out.state.message
        assert run.world.distance_m == pytest.approx(2.6, abs=0.1)
        assert all(abs(pose.y_m - 0.8) < 0.07 for pose in run.trace[-20:])
        assert run.world.touched == 0


def test_it_ends_ahead_of_a_wall_in_front(robot, make_run):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(front_below_m=0.8))
    run, out = follow(make_run, robot, SE2(1.0, 0.8, 0.0), item, outliers=0.02)
    assert out.state.mission_completed
    front = robot.mounts[0].x_m
    assert 4.95 - run.world.pose.x_m - front == pytest.approx(0.8, abs=0.06)


def test_one_stray_reading_of_the_front_sonar_does_not_end_it(differential):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(front_below_m=0.5))
    follower = FollowWall(item, WallConfig(), differential.mounts, 0.5)

    def status(front, new, step):
        ranges = (front, *(math.inf,) * 5, 0.65, math.inf)
        situation = BehaviourInput(SE2(), Twist(0.0, 0.0), ranges, (new,) * 8)
        return follower.step(situation, step * 50_000_000).status

    # The fifth is the fourth, which nothing new has come after.
    fronts = ((2.0, True), (0.3, True), (2.0, True), (0.3, True), (0.3, False), (0.3, True))
    statuses = [status(*front, step) for step, front in enumerate(fronts)]
    assert statuses == [Status.RUNNING] * 5 + [Status.DONE]


def test_it_ends_abeam_of_a_position(robot, make_run):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(position=(3.0, 0.5)))
    run, out = follow(make_run, robot, SE2(1.0, 0.8, 0.0), item)
    assert out.state.mission_completed
    assert run.world.pose.x_m == pytest.approx(3.0, abs=0.05)


def test_the_first_condition_met_ends_it(robot, make_run):
    until = Until(length_m=1.0, front_below_m=0.3, position=(4.0, 1.0))
    item = FollowWallItem("follow_wall", "right", 0.8, until)
    run, out = follow(make_run, robot, SE2(1.0, 0.8, 0.0), item)
    assert out.state.mission_completed
    assert run.world.distance_m == pytest.approx(1.0, abs=0.1)


def test_without_a_wall_it_gives_up_after_a_while(robot, make_run):
    item = FollowWallItem("follow_wall", "left", 0.8, Until(length_m=20.0))
    run, out = follow(make_run, robot, SE2(), item, flat=False)
    assert out.state.mission_failed
    assert "no wall on the left" in out.state.message
    assert run.world.distance_m == pytest.approx(0.8, abs=0.15)


def moved(pose, x_m, turned_deg):
    there = pose @ SE2(x_m, 0.0, math.radians(turned_deg))
    return SE2(there.x_m, there.y_m, there.theta_rad)


@pytest.mark.parametrize(
    ("x_m", "turned_deg", "goes_on"),
    [(0.0, 0.0, True), (-0.4, 25.0, True), (0.0, 35.0, False), (0.0, 180.0, False),
     (-0.6, 0.0, False)],
)  # fmt: skip
def test_after_an_interruption_it_goes_on_only_where_it_was_left_and_in_that_direction(
    robot, make_run, x_m, turned_deg, goes_on
):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(length_m=2.6))
    second = FollowWallItem("follow_wall", "right", 0.8, Until(position=(4.5, 0.8)))
    plan = Mission("wall", StartPose(1.0, 0.8), (item, second))
    run = make_run(robot, mission=plan)
    run.step(ModeRequest(Mode.AUTO))
    for _ in range(80):
        run.step()
    left = run.world.pose
    run.step(ModeRequest(Mode.GUIDED))
    run.world.pose = run.world.odometry = moved(left, x_m, turned_deg)
    run.step()
    for _ in range(2):  # asked for again, it fails again
        out = run.step(ModeRequest(Mode.AUTO))
        assert out.state.mission_failed != goes_on
        assert ("not where it was left" in out.state.message) != goes_on
        assert (out.v_m_s > 0.0) == goes_on
        assert out.state.item == 0
    run.world.pose = run.world.odometry = left  # and goes on once it is put back
    out = run.step(ModeRequest(Mode.AUTO))
    assert out.v_m_s > 0.0


def test_the_way_along_a_wall_is_kept_over_a_restart(robot, make_run):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(length_m=2.6))
    plan = Mission("wall", StartPose(1.0, 0.8), (item,))
    first = make_run(robot, mission=plan)
    first.step(ModeRequest(Mode.AUTO))
    for _ in range(100):
        out = first.step()
    assert 1.0 < out.state.item_s_m < 2.0
    second = make_run(robot, mission=plan, start=first.world.pose)
    second.navigator.auto.resume(out.state.item, out.state.item_s_m)
    second.step(ModeRequest(Mode.AUTO))
    second.until(lambda out: out.state.mission_completed, 60.0)
    assert second.world.pose.x_m == pytest.approx(1.0 + 2.6, abs=0.1)


def test_a_side_without_sonar_is_refused(differential):
    item = FollowWallItem("follow_wall", "left", 0.8, Until(length_m=1.0))
    with pytest.raises(ValueError, match="to the left"):
        FollowWall(item, WallConfig(), differential.mounts[:1], 0.5)
