"""A camera that looks ahead, to 4 m: its ranges along the way make scans, drift is taken out."""

from dataclasses import replace

import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.segment_index import distances
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.local_scans.camera import SOURCE
from robotctl.model.geometry.points import moved
from tests.estimation.slam.keyframes.test_mapper import OFFICE, ape_m
from tests.estimation.slam.lidar_world import along, drifting, scan_of
from tests.estimation.slam.local_scans.test_sonar import TWICE

HEIGHT_M = load_robot(find_file("diff_drive")).camera.mount.z_m
AHEAD = np.radians(np.linspace(-35.0, 35.0, 80))

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def views(poses, rng):
    """Yield what is seen from each pose: errors of each picture's pitch, and of each range."""
    for number, pose in enumerate(poses):
        scan = scan_of(
            OFFICE,
            pose,
            rng,
            sigma_m=0.01,
            reach_m=4.0,
            stamp_ns=number * 100_000_000,
            angles=AHEAD,
        )
        seen_m = np.minimum(scan.ranges_m, 4.0)
        by_pitch_m = (seen_m**2 + HEIGHT_M**2) / HEIGHT_M * np.radians(0.1)
        ranges = scan.ranges_m + by_pitch_m * rng.standard_normal()
        yield replace(scan, ranges_m=ranges, sigmas_m=np.hypot(by_pitch_m, 0.01))


def scans_of(poses, odometry, rng):
    maker = SOURCE.maker(SensedRobot((), LocalisationConfig(), has_camera=True))
    return [
        scan for pair in zip(views(poses, rng), odometry, strict=True) for scan in maker.add(*pair)
    ]


def test_scans_show_the_walls_where_they_are():
    poses = along(TWICE[:3], step_m=0.05, turn_rad=0.05)
    scans = scans_of(poses, poses, np.random.default_rng(1))
    points = np.concatenate([moved(each.odometry, each.scan.points_base()) for each in scans])
    off = np.sort(distances(points, OFFICE.reshape(-1, 4)).min(axis=1))
    assert len(points) > 1500
    assert off[int(0.9 * len(off))] < 0.06


def test_rounds_through_an_office_close_and_take_out_the_drift():
    rng = np.random.default_rng(2)
    poses = along(TWICE, step_m=0.05, turn_rad=0.05)
    scans = scans_of(poses, drifting(poses, rng, bias_rad=0.008), rng)
    mapper = SlamMapper(SOURCE.config)
    places = [mapper.add(each.scan, each.odometry) for each in scans]
    mapper.finish()
    true = [poses[each.scan.stamp_ns // 100_000_000] for each in scans]

    def rows(made):
        return np.array([(each.x_m, each.y_m, each.theta_rad) for each in made])

    assert ape_m(rows([each.odometry for each in scans]), true) > 1.0
    found = [mapper.back_end.pose(each.keyframe) @ each.pose for each in places]
    assert ape_m(rows(found), true) < 0.25


def test_a_robot_without_a_camera_has_no_views():
    with pytest.raises(ValueError, match="no camera is mounted"):
        SOURCE.maker(SensedRobot((), LocalisationConfig()))
