"""SLAM by lidar in drawn offices: loops close, false ones do not."""

import numpy as np
import pytest

from robotctl.estimation.places.recogniser import Candidate
from robotctl.estimation.slam.keyframes import loops
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam_tuning import LoopClosureConfig, SlamTuning, Tolerance
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.lidar_world import along, box, drifting, scan_of

OFFICE = np.concatenate(
    [
        box(0.0, 0.0, 14.0, 10.0),
        box(2.0, 2.0, 10.0, 6.0),
        box(4.0, 0.0, 0.6, 0.4),
        box(9.0, 1.7, 0.8, 0.3),
        box(13.5, 4.0, 0.5, 1.2),
        box(6.0, 9.6, 1.2, 0.4),
        box(3.0, 8.0, 0.3, 0.5),
        box(0.0, 6.0, 0.4, 0.7),
    ]
)
ROUND = [(1.0, 1.0), (13.0, 1.0), (13.0, 9.0), (1.0, 9.0), (1.0, 1.0), (13.0, 1.0)]


def drive(walls, poses, odometry, rng, config=None, reach_m=12.0):
    """Return the mapper after a drive, and its poses (n, 3)."""
    mapper, places = SlamMapper(config), []
    for number, pose in enumerate(poses):
        scan = scan_of(walls, pose, rng, reach_m=reach_m, stamp_ns=number * 500_000_000)
        places.append(mapper.add(scan, None if odometry is None else odometry[number]))
    mapper.finish()
    made = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    return mapper, np.array([(each.x_m, each.y_m, each.theta_rad) for each in made])


def ape_m(made, poses):
    """Return the position error after alignment [m]."""
    true = np.array([(each.x_m, each.y_m) for each in poses])
    off = moved(align(made[:, :2], true), made[:, :2]) - true
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


@pytest.mark.parametrize("with_odometry", [True, False])
def test_a_round_through_an_office_closes(with_odometry):
    rng = np.random.default_rng(1)
    poses = along(ROUND)
    mapper, made = drive(OFFICE, poses, drifting(poses, rng) if with_odometry else None, rng)
    assert ape_m(made, poses) < 0.05
    assert any(link.is_loop and link.second - link.first > 60 for link in mapper.back_end.links)
    assert mapper.tracker.unmatched == 0


def test_a_slip_of_the_wheels_is_noticed_and_does_no_harm():
    rng = np.random.default_rng(2)
    poses = along(ROUND[:3])
    odometry = drifting(poses, rng)
    slipped = [
        pose if row < 20 else odometry[19] @ SE2(0.6, 0.0, 0.5) @ odometry[19].inverse() @ pose
        for row, pose in enumerate(odometry)
    ]
    mapper, made = drive(OFFICE, poses, slipped, rng)
    assert mapper.tracker.slips == 1
    assert ape_m(made, poses) < 0.05


def test_a_place_beyond_all_doubt_is_found_by_its_shape():
    # Without odometry bare walls say nothing of the way along them: metres are lost.
    corner = [(1.0, 0.0, 0.5, 0.4), (3.0, 1.7, 0.4, 0.3), (0.0, 3.0, 0.3, 0.6),
              (5.0, 0.0, 0.3, 0.5), (1.7, 4.5, 0.3, 0.8)]  # fmt: skip
    walls = np.concatenate(
        [box(0.0, 0.0, 20.0, 12.0), box(2.0, 2.0, 16.0, 8.0), *(box(*each) for each in corner)]
    )
    poses = along([(1.0, 1.0), (19.0, 1.0), (19.0, 11.0), (1.0, 11.0), (1.0, 1.0), (19.0, 1.0)])
    rng, mapper = np.random.default_rng(1), SlamMapper()
    for number, pose in enumerate(poses):
        mapper.add(scan_of(walls, pose, rng, reach_m=6.0, stamp_ns=number * 500_000_000))
    closed = [each for each in mapper.loops.log if not each.reason]
    assert [each.found_by for each in closed] == ["shape"]
    at = [round(2e-9 * mapper.keyframes[n].stamp_ns) for n in (closed[0].keyframe, closed[0].other)]
    off = (poses[at[1]].inverse() @ poses[at[0]]).inverse() @ closed[0].pose
    assert np.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.theta_rad) < 0.02


@pytest.mark.parametrize("off_m", [0.4, 3.0])
def test_a_hint_counts_only_where_scans_bear_it_out(monkeypatch, off_m):
    # What the map knows for sure needs no hint, and here it knows all.
    monkeypatch.setattr(loops, "certain", lambda doubts: np.zeros(len(doubts), np.bool_))
    rng = np.random.default_rng(2)
    poses = along(ROUND)
    mapper, _ = drive(OFFICE, poses, drifting(poses, rng), rng)
    true = [poses[round(2e-9 * each.stamp_ns)] for each in mapper.keyframes]
    mapper.loops.log.clear()
    for new in (len(true) - 4, len(true) - 14):
        old = min(range(40), key=lambda each: np.hypot(*_shift(true[each], true[new])))
        at = true[old].inverse() @ true[new]
        pose = SE2(at.x_m + off_m, at.y_m, at.theta_rad)
        mapper.loops.suggest(new, "image", [Candidate(old, pose, 1.0)])
    links = mapper.loops.step() + mapper.loops.step()
    assert bool(links) == (off_m < 1.0)
    assert all(bool(each.reason) == (off_m > 1.0) for each in mapper.loops.log[1:])
    for link in links:
        expected = true[link.first].inverse() @ true[link.second]
        assert np.hypot(*_shift(expected, link.pose)) < 0.06


def test_a_place_seen_from_the_other_side_matches_scans_that_see_the_same(monkeypatch):
    monkeypatch.setattr(loops, "certain", lambda doubts: np.zeros(len(doubts), np.bool_))
    near = SlamTuning(loops=LoopClosureConfig(image=Tolerance(0.3, 0.2)))
    rng = np.random.default_rng(2)
    poses = along([(1.0, 9.0), (1.0, 1.0), (13.0, 1.0), (1.0, 1.0)])
    mapper, _ = drive(
        OFFICE,
        poses,
        drifting(poses, rng),
        rng,
        KeyframeConfig(tuning=near),
        reach_m=4.0,
    )
    true = [poses[round(2e-9 * each.stamp_ns)] for each in mapper.keyframes]
    mapper.loops.log.clear()
    for new in (len(true) - 7, len(true) - 9):
        old = min(range(46), key=lambda each: np.hypot(*_shift(true[each], true[new])))
        there = true[old].inverse() @ true[new]
        assert abs(there.theta_rad) > 3.0
        mapper.loops.suggest(new, "image", [Candidate(old, there, 1.0)])
    mapper.loops.step()
    mapper.loops.step()
    assert [each.reason for each in mapper.loops.log] == 2 * ["not confirmed by another yet"]
    for closure in mapper.loops.log:
        expected = true[closure.other].inverse() @ true[closure.keyframe]
        assert np.hypot(*_shift(expected, closure.pose)) < 0.25  # along a wall


def _shift(a, b):
    """Return how far two poses are apart, (2,)."""
    return b.x_m - a.x_m, b.y_m - a.y_m


def test_a_room_that_looks_alike_is_no_loop():
    rooms = [
        np.concatenate([box(x, 0.0, 4.0, 4.0), box(x + 1.0, 3.0, 0.5, 1.0)]) for x in (0.0, 8.0)
    ]
    gap = 0.8  # doors, and a corridor between them
    walls = [wall for room in rooms for wall in room]
    walls = [wall for wall in walls if not (np.ptp(wall[:, 0]) == 0.0 and wall[0, 0] in (4.0, 8.0))]
    for x in (4.0, 8.0):
        walls += [[[x, 0.0], [x, 2.0 - gap]], [[x, 2.0 + gap], [x, 4.0]]]
    walls += [[[4.0, 2.0 - gap], [8.0, 2.0 - gap]], [[4.0, 2.0 + gap], [8.0, 2.0 + gap]]]
    poses = along([(1.0, 2.0), (3.0, 2.0), (3.0, 1.0), (1.0, 1.0), (1.0, 2.0), (11.0, 2.0),
                   (11.0, 1.0), (9.0, 1.0), (9.0, 2.0)])  # fmt: skip
    rng = np.random.default_rng(3)
    mapper, made = drive(np.array(walls), poses, drifting(poses, rng, bias_rad=0.02), rng)
    assert ape_m(made, poses) < 0.05
    true = np.array([(each.x_m, each.y_m) for each in poses])
    assert mapper.loops.log == [] or all(each.reason for each in mapper.loops.log)
    assert np.hypot(*(true[-1] - true[0])) > 7.0


def test_a_false_loop_is_switched_off():
    rng = np.random.default_rng(4)
    poses = along(ROUND)
    mapper, made = drive(OFFICE, poses, drifting(poses, rng), rng)
    false = KeyframeLink(5, 40, SE2(0.2, 0.1, 0.0), np.diag([1e4, 1e4, 1e4]), is_loop=True)
    mapper.close([false])
    assert mapper.back_end.weights[-1] < 0.25
    after = mapper.back_end.poses
    assert np.abs(after[40] - made[[40]]).max() < 10.0
    assert np.hypot(*(after[40, :2] - after[5, :2])) > 5.0
