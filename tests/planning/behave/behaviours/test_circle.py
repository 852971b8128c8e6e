"""Driving round a point, against the geometry of the circle."""

import math

import numpy as np
import pytest

from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, ReverseRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.circle import Circle, CircleItem
from robotctl.planning.behave.behaviours.kind import Abilities
from robotctl.planning.behave.mission.check import check_mission
from robotctl.planning.behave.mission.mission_file import Mission, StartPose
from robotctl.planning.config import GuardConfig, NavigationConfig

BODY = GuardConfig().outline(())

AUTO, HOLD = ModeRequest(Mode.AUTO), ModeRequest(Mode.HOLD)
CENTRE = (1.0, -2.0)


def circling(make_run, robot, start, *requests, flat=False, centre=CENTRE, **item):
    """Return a run in mode AUTO that has begun a circle."""
    circle = CircleItem("circle", *centre, **({"radius_m": 0.8} | item))
    mission = Mission("circle", StartPose(start.x_m, start.y_m), (circle,))
    run = make_run(robot, mission=mission, start=start, flat=flat)
    run.step(AUTO, *requests)
    return run


def done(run, seconds=120.0):
    out = run.until(lambda out: out.state.mission_completed or out.state.mission_failed, seconds)
    assert out.state.mission_completed, run.messages[-3:]


def around(run, centre=CENTRE):
    """Return distance [m] and angle [rad, unwrapped] about the centre at each step."""
    x, y = np.array([(pose.x_m, pose.y_m) for pose in run.trace]).T - np.array([centre]).T
    return np.hypot(x, y), np.unwrap(np.arctan2(y, x))


STARTS = [SE2(-2.0, -2.0, 0.0), SE2(3.0, 0.5, 0.4), SE2(1.0, -1.7, 2.0)]  # the last one inside


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
@pytest.mark.parametrize("start", STARTS)
def test_each_robot_goes_round_at_the_radius_on_the_named_side(make_run, robot, start, side, sign):
    run = circling(make_run, robot, start, side=side, turns=2.0)
    done(run)
    distance, angle = around(run)
    turned = sign * (angle - angle[-1])
    last = turned > -math.tau
    assert distance[last] == pytest.approx(0.8, rel=0.03)
    assert np.all(np.diff(turned[last]) > -1e-6)
    begin = np.flatnonzero(distance < 1.5 * 0.8)[0]
    # From inside, a robot that steers swings out once more, which is not counted.
    swing_rad = 0.5 if start == STARTS[-1] else 0.05
    assert -0.05 < sign * (angle[-1] - angle[begin]) - 2.0 * math.tau < swing_rad


def test_from_outside_it_leads_along_the_tangent_and_never_cuts_the_circle(make_run, robot):
    """Tangent from D = 3 m to a circle of 0.8 m: sqrt(D^2 - R^2) long, asin(R / D) off."""
    half_rad = math.asin(0.8 / 3.0)
    run = circling(make_run, robot, SE2(-2.0, -2.0, -half_rad))
    length_m = math.sqrt(9.0 - 0.64)
    run.until(lambda _: run.world.distance_m > length_m, 30.0)
    _, angle = around(run)
    assert angle[-1] - angle[0] == pytest.approx(math.pi / 2 - half_rad, abs=0.08)
    done(run)
    assert np.min(around(run)[0]) > 0.97 * 0.8


def test_in_reverse_it_goes_round_backwards(make_run, robot):
    run = circling(make_run, robot, SE2(-1.0, -2.0, math.pi), ReverseRequest(True))
    done(run)
    distance, angle = around(run)
    assert distance[-100:] == pytest.approx(0.8, rel=0.03)
    assert angle[-1] > angle[-100]
    steps = [(a.inverse() @ b).x_m for a, b in zip(run.trace, run.trace[1:], strict=False)]
    assert max(steps) < 1e-3


def test_an_interruption_keeps_the_turns(make_run, differential):
    run = circling(make_run, differential, SE2(0.2, -2.0, -math.pi / 2), turns=1.0)
    run.until(lambda _: run.world.distance_m > 2.0, 30.0)
    run.step(HOLD)
    for _ in range(20):
        run.step()
    run.step(AUTO)
    done(run)
    assert run.world.distance_m == pytest.approx(math.tau * 0.8, rel=0.05)


def test_a_restart_continues_along_the_circle(differential):
    circle = Circle(
        CircleItem("circle", 0.0, 0.0, 0.5), NavigationConfig().pursuit, differential.drive
    )
    circle.resume(2.5)
    assert circle.s_m == pytest.approx(2.5)
    circle.reset()
    assert circle.s_m == 0.0


def test_it_stops_before_what_stands_on_the_circle_and_says_so(make_run, robot):
    run = circling(make_run, robot, SE2(3.0, 2.5, 0.0), flat=True, centre=(3.95, 2.5), radius_m=1.2)
    out = run.until(lambda out: out.state.mission_failed, 60.0)
    assert "blocked" in out.state.message
    assert run.world.touched == 0


def test_a_circle_that_a_robot_cannot_drive_is_refused(steered):
    least_m = steered.drive.min_turning_radius_m
    circle = CircleItem("circle", 0.0, 0.0, least_m)
    mission = Mission("circle", StartPose(0.0, 0.0), (circle,))
    with pytest.raises(MissionError, match=rf"circles of {1.1 * least_m:.2f} m or more"):
        check_mission(mission, Abilities(steered.drive, frozenset(), GuardConfig(), BODY))
