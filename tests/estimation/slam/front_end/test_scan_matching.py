"""Scan matching: known motions are found, what is not seen is not claimed."""

import math

import numpy as np
import pytest

from robotctl.estimation.slam.front_end.agreement import agreement, view_of
from robotctl.estimation.slam.front_end.correlative import POINTS_AS_ONE, Window, search
from robotctl.estimation.slam.front_end.point_to_line import binned, refine, share_on_map
from robotctl.estimation.slam.front_end.score_field import LEVELS, RESOLUTION_M, score_field
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


def test_a_cell_of_a_coarse_level_bounds_the_block_that_begins_with_it():
    field = score_field(surfaces(ROOM, SE2())[0].outline)
    rng = np.random.default_rng(0)
    _, rows, columns = field.cells.shape
    for y, x in zip(rng.integers(rows, size=500), rng.integers(columns, size=500), strict=True):
        for level in range(LEVELS):
            block = field.cells[0, y : y + 2**level, x : x + 2**level]
            assert field.cells[level, y, x] == block.max()


def scores_of_all_poses(field, points, window):
    """Return turns, shifts, the score of each pose and its penalty, (turns, shifts, shifts)."""
    half = int(np.ceil(window.shift_m / RESOLUTION_M))
    far_m = max(np.percentile(np.hypot(*points.T), 90.0), 1.0)
    steps = int(np.ceil(window.turn_rad / (RESOLUTION_M / far_m)))
    turns = np.linspace(-window.turn_rad, window.turn_rad, 2 * steps + 1)
    shifts_m = RESOLUTION_M * np.arange(-half, half + 1)
    wide = 2000
    cells = np.pad(field.cells[0], wide)
    scores = np.zeros((len(turns), len(shifts_m), len(shifts_m)))
    for k, turn in enumerate(window.centre.theta_rad + turns):
        c, s = np.cos(turn), np.sin(turn)
        at = points @ np.array([[c, s], [-s, c]])
        at += (window.centre.x_m - field.x_m, window.centre.y_m - field.y_m)
        for column, row in np.floor(at / RESOLUTION_M).astype(int) + wide - half:
            scores[k] += cells[row : row + 2 * half + 1, column : column + 2 * half + 1]
    off = (turns / window.sigma_rad)[:, None, None] ** 2
    off = off + (shifts_m / window.sigma_m)[:, None] ** 2 + (shifts_m / window.sigma_m) ** 2
    return turns, shifts_m, scores / (255.0 * len(points)), 0.5 / POINTS_AS_ONE * off


FAR = np.array([[80.0, 3.0], [-2.0, 29.0], [0.0, -60.0]])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "window",
    [
        Window(SE2(0.1, 0.0, 0.1), 0.6, 0.3),
        Window(SE2(0.1, 0.0, 0.1), 0.2, 0.04, 0.1, 0.02),
        Window(SE2(-0.2, 0.1, -0.1), 1.7, 0.5, 0.6, 0.2),
        Window(SE2(0.0, 0.0, 0.2), 0.04, 0.5),
    ],
)
def test_branch_and_bound_finds_what_trying_all_poses_finds(seed, window):
    rng = np.random.default_rng(seed)
    motion = SE2(*rng.uniform(-0.4, 0.4, 3).tolist())
    first, second = surfaces(ROOM, motion, seed)
    field = score_field(first.outline)
    points = np.concatenate([second.points[::5], FAR])
    turns, shifts_m, scores, off = scores_of_all_poses(field, points, window)
    found = search(field, points, window, -1.0)
    x_m, y_m = window.centre.x_m + shifts_m, window.centre.y_m + shifts_m[:, None]
    k = np.argmin(np.abs(window.centre.theta_rad + turns - found.pose.theta_rad))
    i, j = np.argmin(np.abs(y_m - found.pose.y_m)), np.argmin(np.abs(x_m - found.pose.x_m))
    assert found.pose.x_m == pytest.approx(x_m[j])
    assert found.pose.y_m == pytest.approx(y_m[i, 0])
    assert found.pose.theta_rad == pytest.approx(window.centre.theta_rad + turns[k])
    assert found.score == pytest.approx(scores[k, i, j], abs=1e-12)
    assert (scores - off)[k, i, j] == pytest.approx((scores - off).max(), abs=1e-12)
    # The best of those that are not near it.
    apart = found.pose @ SE2(0.013, 0.007, 0.003)
    away_m = np.hypot(x_m - apart.x_m, y_m - apart.y_m)
    turn = np.abs(window.centre.theta_rad + turns - apart.theta_rad)
    is_near = (turn < 0.2)[:, None, None] & (away_m < 0.5)
    others = np.where(is_near, -np.inf, scores - off)
    other = search(field, points, window, 0.1, apart)
    if others.max() <= 0.1:
        assert other is None
    else:
        assert other.score == pytest.approx(scores[others == others.max()].max(), abs=1e-12)


def test_half_a_turn_to_either_side_is_one_heading():
    first, _ = surfaces(ROOM, SE2())
    field, behind = score_field(first.outline), SE2(0.0, 0.0, math.pi)
    found = search(field, first.points, Window(behind, 0.5, math.pi), 0.5)
    assert abs(math.remainder(found.pose.theta_rad, math.tau)) < 0.05
    assert search(field, first.points, Window(behind, 0.3, math.pi), 0.9, found.pose) is None


def test_a_search_finds_nothing_below_the_least_score():
    first, second = surfaces(ROOM, SE2(0.2, 0.1, 0.1))
    field, window = score_field(first.outline), Window(SE2(), 0.6, 0.3)
    best = search(field, second.points, window, -1.0).score
    assert search(field, second.points, window, best - 1e-9).score == best
    assert search(field, second.points, window, best) is None


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
    same = agreement(view_of(blocked), surface, SE2())
    other = agreement(view_of(through), surface, SE2())
    assert same.of_seen == 1.0
    assert other.contradicts > 0.05


def test_the_two_sides_of_a_wall_are_not_the_same():
    rng = np.random.default_rng(0)
    wall = np.array([[[2.0, -6.0], [2.0, 6.0]]])
    before, behind = SE2(0.0, 0.0, 0.0), SE2(4.0, 0.0, math.pi)
    front, back = (surface_of(scan_of(wall, each, rng)) for each in (before, behind))
    view = view_of(scan_of(wall, before, rng))
    assert agreement(view, front, SE2()).agrees > 0.9
    seen = agreement(view, back, behind)
    assert seen.agrees < 0.3  # what has no normal, far along the wall
    assert seen.contradicts == 0.0


def test_a_scan_lies_on_its_own_walls_only_where_it_was_taken():
    surface = surface_of(scan_of(ROOM, SE2(), np.random.default_rng(0)))
    walls = binned(surface)
    assert share_on_map(walls, surface, SE2()) == pytest.approx(1.0)
    assert share_on_map(walls, surface, SE2(0.0, 0.0, 0.5)) < 0.5


def test_points_far_along_a_corridor_say_nothing_of_walls():
    surface = surface_of(scan_of(CORRIDOR, SE2(), np.random.default_rng(0)))
    walls = surface.walls
    assert 0 < len(walls.points) < len(surface.points)
    assert np.abs(walls.points[:, 0]).max() < 0.7 * np.abs(surface.points[:, 0]).max()
