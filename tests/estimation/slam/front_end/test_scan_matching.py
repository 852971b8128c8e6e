"""Scan matching: known motions are found, what is not seen is not claimed."""

import numpy as np
import pytest

from robotctl.estimation.slam.front_end.agreement import agreement, view_of
from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import binned, refine
from robotctl.estimation.slam.front_end.score_field import RESOLUTION_M, score_field
from robotctl.estimation.slam.front_end.surface import surface_of
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.lidar_world import box, scan_of

ROOM = np.concatenate(
    [box(-3.0, -2.0, 9.0, 6.0), box(2.0, 1.0, 0.8, 0.5), box(4.0, -1.5, 0.4, 1.5)]
)
CORRIDOR = box(-40.0, -1.0, 80.0, 2.0)


def surfaces(walls, motion, seed=0):
    rng = np.random.default_rng(seed)
    first, second = (scan_of(walls, pose, rng) for pose in (SE2(), motion))
    return surface_of(first), surface_of(second)


@pytest.mark.parametrize("motion", [SE2(0.5, 0.1, 0.4), SE2(-0.3, 0.4, -0.9), SE2(0.9, -0.5, 0.0)])
def test_a_known_motion_is_found_from_far_off(motion):
    first, second = surfaces(ROOM, motion)
    found = search(score_field(first.outline), second.points, Window(SE2(), 1.5, 1.2), 0.3)
    match = refine(binned(first), second, found.pose)
    assert match.pose.x_m == pytest.approx(motion.x_m, abs=0.01)
    assert match.pose.y_m == pytest.approx(motion.y_m, abs=0.01)
    assert match.pose.theta_rad == pytest.approx(motion.theta_rad, abs=0.005)


@pytest.mark.parametrize("seed", range(4))
def test_branch_and_bound_finds_what_trying_all_poses_finds(seed):
    rng = np.random.default_rng(seed)
    motion = SE2(*rng.uniform(-0.4, 0.4, 3).tolist())
    first, second = surfaces(ROOM, motion, seed)
    field = score_field(first.outline)
    points = second.points[::3]
    window = Window(SE2(0.1, 0.0, 0.1), 0.6, 0.3)
    found = search(field, points, window, 0.0)
    cells = field.cells[: field.rows[0] * field.columns[0]].reshape(field.rows[0], -1)
    half, best = int(np.ceil(0.6 / RESOLUTION_M)), 0.0
    far = np.percentile(np.hypot(*points.T), 90.0)
    steps = int(np.ceil(0.3 / (RESOLUTION_M / far)))
    for turn in 0.1 + np.linspace(-0.3, 0.3, 2 * steps + 1):
        c, s = np.cos(turn), np.sin(turn)
        at = points @ np.array([[c, s], [-s, c]]) + (0.1 - field.x_m, -field.y_m)
        column, row = np.floor(at / RESOLUTION_M).astype(int).T
        for i in range(-half, half + 1):
            for j in range(-half, half + 1):
                x, y = column + j, row + i
                inside = (x >= 0) & (y >= 0) & (x < cells.shape[1]) & (y < cells.shape[0])
                best = max(best, cells[y[inside], x[inside]].sum() / (255.0 * len(points)))
    assert found.score == pytest.approx(best, abs=1e-12)


def test_nothing_is_known_along_a_corridor_but_what_odometry_says():
    first, second = surfaces(CORRIDOR, SE2(0.5, 0.02, 0.03))
    expected = SE2(0.46, 0.0, 0.0)
    known = np.diag([0.05**-2, 0.05**-2, 0.05**-2])
    match = refine(binned(first), second, expected, expected, known)
    along, across = match.information[0, 0], match.information[1, 1]
    assert along < 0.02 * across
    assert match.pose.x_m == pytest.approx(0.46, abs=0.02)  # held by the prior
    assert match.pose.y_m == pytest.approx(0.02, abs=0.01)  # seen
    assert match.pose.theta_rad == pytest.approx(0.03, abs=0.005)


def test_the_covariance_of_a_room_holds_the_errors():
    motion, squares = SE2(0.3, 0.2, 0.2), []
    for seed in range(20):
        first, second = surfaces(ROOM, motion, seed)
        match = refine(binned(first), second, motion)
        off = np.array((motion.inverse() @ match.pose).log())
        squares.append(off @ match.information @ off)
    assert np.mean(squares) < 3.0  # on the safe side: real walls are worse than drawn ones


def test_a_wall_that_a_beam_went_through_contradicts():
    rng = np.random.default_rng(0)
    near = np.concatenate([CORRIDOR, box(3.0, -1.0, 0.1, 2.0)])
    through, blocked = (scan_of(walls, SE2(), rng) for walls in (CORRIDOR, near))
    surface = surface_of(blocked)
    same = agreement(view_of(blocked), surface.points, surface.weights, SE2())
    other = agreement(view_of(through), surface.points, surface.weights, SE2())
    assert same.of_seen == 1.0
    assert other.contradicts > 0.05
