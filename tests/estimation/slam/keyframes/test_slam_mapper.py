"""SLAM by lidar in drawn offices: loops close, false ones do not."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.back_end import Link
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
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


def drive(walls, poses, odometry, rng):
    """Return the mapper after a drive, and its poses (n, 3)."""
    mapper, places = SlamMapper(), []
    for number, pose in enumerate(poses):
        scan = scan_of(walls, pose, rng, stamp_ns=number * 500_000_000)
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
    assert mapper.lost == 0


def test_a_slip_of_the_wheels_is_noticed_and_does_no_harm():
    rng = np.random.default_rng(2)
    poses = along(ROUND[:3])
    odometry = drifting(poses, rng)
    slipped = [
        pose if row < 20 else odometry[19] @ SE2(0.6, 0.0, 0.5) @ odometry[19].inverse() @ pose
        for row, pose in enumerate(odometry)
    ]
    mapper, made = drive(OFFICE, poses, slipped, rng)
    assert mapper.slips == 1
    assert ape_m(made, poses) < 0.05


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
    false = Link(5, 40, SE2(0.2, 0.1, 0.0), np.diag([1e4, 1e4, 1e4]), is_loop=True)
    mapper.close([false])
    assert mapper.back_end.weights[-1] < 0.25
    after = mapper.back_end.poses
    assert np.abs(after[40] - made[[40]]).max() < 10.0
    assert np.hypot(*(after[40, :2] - after[5, :2])) > 5.0
