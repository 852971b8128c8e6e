"""Mapping where nothing but scans tells the motion, and where odometry tells a wrong one."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.motion import MotionHabit
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE, ROUND, ape_m
from tests.estimation.slam.lidar_world import along, box, drifting, scan_of

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled

STAMPS = {
    "equal": lambda number: 10**18,
    "in order": lambda number: 10**18 + number,
    "a second apart": lambda number: number * 10**9,
    "of a rate that jumps": lambda number: number * 10**8 * (1 + number % 3),
}


def long_corridors():
    """Return walls (n, 2, 2) of four corridors round a block, with a few things in them."""
    rng = np.random.default_rng(1)
    things = [
        box(x, rng.choice([0.05, 1.7, 12.05, 13.7]), rng.uniform(0.3, 1.2), 0.25)
        for x in rng.uniform(3.0, 37.0, 20)
    ]
    return np.concatenate([box(0, 0, 40, 14), box(2, 2, 36, 10), *things])


CORRIDORS = long_corridors()
ROUND_THE_BLOCK = [(1.0, 1.0), (39.0, 1.0), (39.0, 13.0), (1.0, 13.0)]


def uneven(corners, rng):
    """Return poses along a path with steps of 0.2 to 0.6 m."""
    fine = along(corners, step_m=0.05, turn_rad=0.05)
    rows, row = [], 0
    while row < len(fine):
        rows.append(row)
        row += int(rng.integers(4, 13))
    return [fine[row] for row in rows]


def mapped(poses, rng, stamp_of, odometry=None):
    """Return the mapper after a drive, and its poses (n, 3)."""
    mapper, places = SlamMapper(), []
    for number, pose in enumerate(poses):
        scan = scan_of(OFFICE, pose, rng, sigma_m=0.02, stamp_ns=stamp_of(number))
        places.append(mapper.add(scan, None if odometry is None else odometry[number]))
    mapper.finish()
    made = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    return mapper, np.array([(each.x_m, each.y_m, each.theta_rad) for each in made])


@pytest.mark.parametrize("stamps", STAMPS)
def test_without_odometry_the_drive_is_that_of_the_scans_whatever_the_stamps(stamps):
    rng = np.random.default_rng(5)
    poses = uneven(ROUND, rng)
    mapper, made = mapped(poses, rng, STAMPS[stamps])
    assert ape_m(made, poses) < 0.1
    assert mapper.tracker.slips == 0
    assert mapper.robot.unmeasured_m == pytest.approx(mapper.robot.travelled_m)


def spoiled(odometry, begin, end, wrong):
    """Return odometry whose steps from one row to another are `wrong`."""
    result = [odometry[0]]
    for row, (before, now) in enumerate(itertools.pairwise(odometry)):
        result.append(result[-1] @ (wrong if begin <= row < end else before.inverse() @ now))
    return result


def test_a_dead_encoder_is_noticed_within_a_metre_and_believed_again():
    rng = np.random.default_rng(6)
    poses = along(ROUND)
    begin, end = 45, 95
    odometry = spoiled(drifting(poses, rng), begin, end, SE2())
    mapper, beliefs = SlamMapper(), []
    places = []
    for number, (pose, at) in enumerate(zip(poses, odometry, strict=True)):
        places.append(mapper.add(scan_of(OFFICE, pose, rng, stamp_ns=number * 10**8), at))
        beliefs.append(mapper.robot.trust.is_trusted)
    mapper.finish()
    made = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    ways_m = [np.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in itertools.pairwise(poses)]
    assert all(beliefs[:begin])
    noticed = beliefs.index(False)
    assert sum(ways_m[begin:noticed]) < 1.0
    assert not any(beliefs[noticed:end])
    assert beliefs[-1]
    assert ape_m(np.array([(each.x_m, each.y_m) for each in made]), poses) < 0.1


def test_a_dead_encoder_is_noticed_in_a_long_corridor_with_few_things_in_it():
    rng = np.random.default_rng(1)
    poses = along(ROUND_THE_BLOCK)
    odometry = spoiled(drifting(poses, rng), 200, 240, SE2())
    around = np.radians(np.arange(-180.0, 180.0, 2.0))
    mapper, places = SlamMapper(), []
    for number, (pose, at) in enumerate(zip(poses, odometry, strict=True)):
        scan = scan_of(CORRIDORS, pose, rng, reach_m=20.0, stamp_ns=number * 10**9, angles=around)
        places.append(mapper.add(scan, at))
    mapper.finish()
    made = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    assert ape_m(np.array([(each.x_m, each.y_m) for each in made]), poses) < 0.2
    assert mapper.robot.unmeasured_m > 11.0  # and until scans see the way again


def test_odometry_that_drives_on_while_the_robot_stands_is_left_out():
    rng = np.random.default_rng(7)
    poses = along(ROUND[:3])
    stands = poses[:30] + [poses[30]] * 10 + poses[30:]
    spun = spoiled(drifting(stands, rng), 30, 40, SE2(0.3, 0.0, 0.0))
    mapper, made = mapped(stands, rng, STAMPS["a second apart"], spun)
    assert mapper.robot.trust.losses == 1
    assert ape_m(made, stands) < 0.05


@pytest.mark.parametrize(
    ("walls", "way", "most_m"),
    [(OFFICE, ROUND, 0.1), (CORRIDORS, ROUND_THE_BLOCK, 1.0)],
    ids=["office", "corridors"],
)
def test_driving_in_reverse_is_no_slip_though_walls_beside_the_robot_come_into_view(
    walls, way, most_m
):
    rng = np.random.default_rng(1)
    poses = [each @ SE2(0.0, 0.0, np.pi) for each in along(way, step_m=1.0)]
    mapper, places = SlamMapper(), []
    for number, (pose, at) in enumerate(zip(poses, drifting(poses, rng), strict=True)):
        scan = scan_of(walls, pose, rng, reach_m=20.0, stamp_ns=number * 10**9)
        places.append(mapper.add(scan, at))
    mapper.finish()
    made = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    assert ape_m(np.array([(each.x_m, each.y_m) for each in made]), poses) < most_m


def test_the_motion_is_guessed_by_what_guessed_best():
    by_scan, by_time = MotionHabit(1.5), MotionHabit(1.5)
    for number in range(20):
        took_s = 0.5 + 0.4 * (number % 2)
        by_scan.predict(took_s)
        by_scan.learn(SE2(0.5, 0.0, 0.0), took_s)
        by_time.predict(took_s)
        by_time.learn(SE2(0.4 * took_s, 0.0, 0.0), took_s)
    assert by_scan.predict(0.9).motion.x_m == pytest.approx(0.5)
    assert by_time.predict(0.5).motion.x_m == pytest.approx(0.2, abs=0.02)
    assert by_time.predict(0.5).sigma_m < 0.15
    assert by_time.predict(0.0).motion.x_m == pytest.approx(0.36)  # equal stamps say nothing


@pytest.mark.recordings("carmen/seattle-corrected.log.gz")
@pytest.mark.parametrize("every", [1, 2])
def test_a_building_is_mapped_without_odometry_and_stamps(recordings, every):
    log = read_recording(recordings / "carmen" / "seattle-corrected.log.gz", with_sonars=False)
    scans = log.scans[::every]
    mapper = SlamMapper()
    places = [mapper.add(replace(each.scan, stamp_ns=10**18)) for each in scans]
    mapper.finish()
    made = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    reference = [each.reference for each in scans]
    assert ape_m(np.array([(each.x_m, each.y_m) for each in made]), reference) < 0.15
