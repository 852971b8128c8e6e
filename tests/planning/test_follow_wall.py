"""Following walls in the simulated flat."""

import math

import pytest

from robotctl.model.se2 import SE2
from robotctl.model.twist import Twist
from robotctl.planning.follow_wall import FollowWall, WallConfig
from robotctl.planning.mission import FollowWallItem, Mission, StartPose, Until
from robotctl.planning.mode import Mode
from robotctl.planning.requests import ModeRequest
from robotctl.planning.situation import Situation, Status


def follow(make_run, robot, start, item, **world):
    plan = Mission("wall", "flat", StartPose(start.x_m, start.y_m), (item,))
    run = make_run(robot, mission=plan, start=start, **world)
    run.step(ModeRequest(Mode.AUTO))
    out = run.until(lambda out: out.mission_completed or out.mission_failed, 60.0)
    return run, out


@pytest.mark.parametrize("offset", [-0.2, 0.0, 0.25])
def test_the_distance_converges_on_either_side(robot, make_run, offset):
    for side, start in (
        ("right", SE2(1.0, 0.8 + offset, 0.0)),
        ("left", SE2(4.0, 0.8 + offset, math.pi)),
    ):
        item = FollowWallItem("follow_wall", side, 0.8, Until(length_m=2.6))
        run, out = follow(make_run, robot, start, item, range_noise_m=0.01)
        assert out.mission_completed, out.message
        assert run.world.distance_m == pytest.approx(2.6, abs=0.1)
        assert all(abs(pose.y_m - 0.8) < 0.07 for pose in run.trace[-20:])
        assert run.world.touched == 0


def test_it_ends_ahead_of_a_wall_in_front(robot, make_run):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(front_below_m=0.8))
    run, out = follow(make_run, robot, SE2(1.0, 0.8, 0.0), item, outliers=0.02)
    assert out.mission_completed
    front = robot.mounts[0].x_m
    assert 4.95 - run.world.pose.x_m - front == pytest.approx(0.8, abs=0.06)


def test_one_stray_reading_of_the_front_sonar_does_not_end_it(differential):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(front_below_m=0.5))
    follower = FollowWall(item, WallConfig(), differential.mounts)

    def status(front, new, step):
        ranges = (front, *(math.inf,) * 5, 0.65, math.inf)
        situation = Situation(SE2(), Twist(0.0, 0.0), ranges, (new,) * 8)
        return follower.step(situation, step * 50_000_000).status

    # The fifth is the fourth, which nothing new has come after.
    fronts = ((2.0, True), (0.3, True), (2.0, True), (0.3, True), (0.3, False), (0.3, True))
    statuses = [status(*front, step) for step, front in enumerate(fronts)]
    assert statuses == [Status.RUNNING] * 5 + [Status.DONE]


def test_it_ends_abeam_of_a_position(robot, make_run):
    item = FollowWallItem("follow_wall", "right", 0.8, Until(position=(3.0, 0.5)))
    run, out = follow(make_run, robot, SE2(1.0, 0.8, 0.0), item)
    assert out.mission_completed
    assert run.world.pose.x_m == pytest.approx(3.0, abs=0.05)


def test_the_first_condition_met_ends_it(robot, make_run):
    until = Until(length_m=1.0, front_below_m=0.3, position=(4.0, 1.0))
    item = FollowWallItem("follow_wall", "right", 0.8, until)
    run, out = follow(make_run, robot, SE2(1.0, 0.8, 0.0), item)
    assert out.mission_completed
    assert run.world.distance_m == pytest.approx(1.0, abs=0.1)


def test_without_a_wall_it_gives_up_after_a_while(robot, make_run):
    item = FollowWallItem("follow_wall", "left", 0.8, Until(length_m=20.0))
    run, out = follow(make_run, robot, SE2(), item, flat=False)
    assert out.mission_failed
    assert "no wall on the left" in out.message
    assert run.world.distance_m == pytest.approx(0.8, abs=0.15)


def test_a_side_without_sonar_is_refused(differential):
    item = FollowWallItem("follow_wall", "left", 0.8, Until(length_m=1.0))
    with pytest.raises(ValueError, match="to the left"):
        FollowWall(item, WallConfig(), differential.mounts[:1])
