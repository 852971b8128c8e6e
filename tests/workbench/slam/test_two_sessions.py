"""Two drives of one building become one map, from wherever the second began."""

from dataclasses import replace

import numpy as np
import pytest

from robotctl.estimation.slam.local_scans.sonar import SOURCE
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.scan_files import write_scan_results
from robotctl.workbench.slam.scans import (
    ScanSlamError,
    scan_slam,
    scan_slam_of,
    scan_slam_onto,
)
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, box, drifting, scan_of
from tests.estimation.slam.local_scans.test_sonar import heard, scans_of

FULL_CIRCLE = np.radians(np.arange(-180.0, 180.0, 3.0))
ROUND = along([(1.0, 1.0), (13.0, 1.0), (13.0, 9.0), (1.0, 9.0)] * 2, 0.05, 0.05)
HALF = int(0.6 * len(ROUND))
FIRST = along([(1.0, 1.0), (13.0, 1.0), (13.0, 4.0)], 0.3)
SECOND = along([(4.0, 9.0), (13.0, 9.0), (13.0, 1.0), (9.0, 1.0)], 0.25)
"""It begins where the first has never been."""

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def recording(walls, poses, seed):
    rng = np.random.default_rng(seed)
    scans = tuple(
        RecordedScan(
            scan_of(walls, pose, rng, stamp_ns=number * 400_000_000, angles=FULL_CIRCLE), wheels
        )
        for number, (pose, wheels) in enumerate(zip(poses, drifting(poses, rng), strict=True))
    )
    return Recording("a drive", scans)


def silent(_done, _count):
    pass


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Folder of the first drive's map."""
    folder = tmp_path_factory.mktemp("first")
    write_scan_results(scan_slam_of(recording(OFFICE, FIRST, 1), silent), folder)
    return folder


def saved(folder):
    return load_keyframes(folder / "map.keyframes")


def test_the_second_drive_is_joined_to_the_first(first):
    before = saved(first)
    result = scan_slam_onto(recording(OFFICE, SECOND, 2), before, silent)
    true = np.array([(each.x_m, each.y_m) for each in SECOND])
    off = moved(FIRST[0], result.estimate.poses[:, :2]) - true
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.05
    assert len(result.mapper.keyframes) > len(before.keyframes) + 15


def test_a_map_joined_to_itself_stays_as_it_is(first):
    file = first / "map.keyframes"
    result = scan_slam(file, None, silent, file)
    before = saved(first)
    assert len(result.mapper.keyframes) == len(before.keyframes)
    off = result.estimate.poses - before.poses
    assert np.abs(off[:, :2]).max() < 0.02


def test_another_building_is_refused(first):
    other = np.concatenate([box(0.0, 0.0, 9.0, 7.0), box(3.0, 2.0, 1.0, 3.0)])
    poses = along([(1.0, 1.0), (8.0, 1.0), (8.0, 3.0)], 0.5)
    with pytest.raises(ScanSlamError, match=r"none of its .* scans is found"):
        scan_slam_onto(recording(other, poses, 3), saved(first), silent)


def heard_recording(poses, seed):
    """Return a drive of a robot with a ring of sonars."""
    rng = np.random.default_rng(seed)
    odometry = drifting(poses, rng, bias_rad=0.002)
    readings = heard(OFFICE, poses, rng)
    way = Trajectory.of((each.stamp_ns for each in readings), odometry)
    return Recording("a drive", tuple(scans_of(readings, odometry)), odometry=way)


def test_by_sonar_the_second_drive_goes_on_where_the_first_ended(first, tmp_path):
    drive = heard_recording(ROUND[:HALF], 4)
    one = scan_slam_of(drive, silent, SOURCE.config)
    write_scan_results(replace(one, sensor="sonar"), tmp_path)
    before = saved(tmp_path)
    number, pose = before.place
    # The last scan is of the middle of the last two metres; from there it drove on.
    last = SE2(*one.estimate.poses[-1].tolist())
    on = last.inverse() @ SE2(*before.poses[number].tolist()) @ pose
    true_on = ROUND[drive.scans[-1].scan.stamp_ns // 50_000_000].inverse() @ ROUND[HALF - 1]
    assert true_on.x_m > 0.9
    assert np.hypot(on.x_m - true_on.x_m, on.y_m - true_on.y_m) < 0.1
    second = heard_recording(ROUND[HALF:], 5)
    result = scan_slam_of(second, silent, SOURCE.config, after=before)
    assert result.mapper.keyframes[: len(before.keyframes)] == before.keyframes
    stamps_ns = np.array([each.stamp_ns for each in result.mapper.keyframes])
    stamps_ns[len(before.keyframes) :] += HALF * 50_000_000
    true = np.array([(ROUND[row].x_m, ROUND[row].y_m) for row in stamps_ns // 50_000_000])
    both = result.mapper.back_end.poses[:, :2]
    off = moved(align(both, true), both) - true
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.15
    lidar = first / "map.keyframes"
    with pytest.raises(ScanSlamError, match=r"a map made by sonar, needed is one by lidar"):
        scan_slam(lidar, None, silent, tmp_path / "map.keyframes")
