"""The score of the camera, on a room and views made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_sim.camera.truth import sightings
from firmware_sim.config.camera_parameters import CameraMount, Intrinsics
from firmware_sim.world.world import load_world
from robotctl.app.scoring.camera_score import CameraScore
from robotctl.app.scoring.score import StampedPose
from robotctl.messages.estimation import CameraView, SeenObstacle

LENS = Intrinsics(640, 480, 450.0, 450.0, 319.5, 239.5)
MOUNT = CameraMount(0.2, 0.0, 0.3, pitch_deg=20.0)
HERE = StampedPose(1_000, 1.0, 2.0, 0.0)
"""The camera stands at x 1.2 m; the wall ahead is 2.8 m from there, the can's foot 0.97 m."""
ROOM = """
[world]
name = "room"
start = { x_m = 1.0, y_m = 2.0 }
[[wall]]
points = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]
closed = true
[[obstacle]]
name = "can"
centre = [2.2, 2.0]
radius_m = 0.03
height_m = 0.1
"""
CAN_M = 1.0 - 0.03
AT_CAN = SeenObstacle(0.2 + CAN_M, 0.0, (1e-4, 0.0, 1e-4), 0.06)


@pytest.fixture
def score(tmp_path):
    (tmp_path / "room.toml").write_text(ROOM)
    return CameraScore(load_world(tmp_path / "room.toml"), LENS, MOUNT)


def view(ranges=(), angles=(), sigma_m=0.02, **changes):
    sigmas = tuple(math.nan if math.isnan(r) else sigma_m for r in ranges)
    beams = (tuple(angles), tuple(ranges), sigmas, (0.3,) * len(sigmas))
    return CameraView(1_000, 0.2, 0.0, 4.0, *beams, step_us=2000.0, **changes)


def scored(score, *views):
    for each in views:
        score.view(each)
    score.truth(HERE)
    return score.result()


def test_without_a_view_there_is_no_score(score):
    score.truth(HERE)
    assert score.result() is None


def test_ranges_are_compared_with_what_stands_there(score):
    # Beside the can the wall ahead is 2.8 m away, measured along the ray.
    angles = (0.1, -0.1, 0.0)
    wall_m = 2.8 / math.cos(0.1)
    found = scored(score, view((1.01 * wall_m, 1.03 * wall_m, 1.02 * CAN_M), angles))
    assert found.range_error == pytest.approx(0.02, abs=1e-3)
    assert found.within_3_sigma == pytest.approx(2 / 3)
    assert found.step_ms == 2.0


def test_a_beam_that_goes_on_through_the_wall_is_an_error_and_one_not_judged_is_none(score):
    found = scored(score, view((math.inf, math.nan), (0.1, -0.1)))
    assert found.range_error == math.inf
    assert found.within_3_sigma == 0.0


def test_a_thing_in_sight_is_found_or_missed(score):
    found = scored(score, view(obstacles=(AT_CAN,)), view())
    assert (found.obstacles, found.found, found.false) == (2, 1, 0)
    assert found.obstacle_rmse_m == pytest.approx(0.0, abs=0.005)


def test_a_thing_that_is_half_hidden_is_neither_found_nor_missed(score, tmp_path):
    post = """
[[furniture]]
kind = "pillar"
name = "post"
centre = [1.7, 1.995]
radius_m = 0.01
height_m = 1.0
"""
    (tmp_path / "hidden.toml").write_text(ROOM + post)
    world = load_world(tmp_path / "hidden.toml")
    (can,) = (t for t in sightings(world, HERE[1:], LENS, MOUNT) if t.name == "can")
    assert 0.1 < can.seen < 0.9
    found = scored(CameraScore(world, LENS, MOUNT), view(obstacles=(AT_CAN,)), view())
    assert (found.obstacles, found.found, found.false) == (0, 0, 0)
    assert found.obstacle_rmse_m is None


def test_a_report_where_nothing_stands_is_false_and_one_of_the_wall_is_not(score):
    nothing = SeenObstacle(1.5, 0.5, (1e-4, 0.0, 1e-4), 0.1)
    wall = SeenObstacle(3.0, 0.5, (1e-4, 0.0, 1e-4), 0.1)
    found = scored(score, view(obstacles=(nothing, wall)))
    assert (found.obstacles, found.found, found.false) == (1, 0, 1)
    assert found.obstacle_rmse_m is None


def test_what_the_camera_did_not_judge_is_not_scored(score):
    found = scored(score, view((0.5,), (0.1,), trouble="glare"), view())
    assert (found.pictures, found.untrusted) == (2, 1)
    assert found.range_error is None


def test_a_view_is_compared_with_the_pose_of_its_own_time(score):
    late = StampedPose(3_000, 1.4, 2.0, 0.0)
    before = StampedPose(0, 0.8, 2.0, 0.0)
    score.view(view((2.8 / math.cos(0.1),), (0.1,)))
    score.truth(before)
    assert score.result() is None
    score.truth(late)
    assert score.result().range_error == pytest.approx(0.0, abs=1e-9)


def test_the_room_is_what_the_figures_above_say(score):
    # The can of 16 sides about a circle of 3 cm is up to 0.6 mm wider.
    from firmware_sim.camera.truth import true_ranges

    ranges = true_ranges(score._world, (1.0, 2.0, 0.0), MOUNT, np.array([0.0, 0.1]))
    assert ranges == pytest.approx([CAN_M, 2.8 / math.cos(0.1)], abs=1e-3)
