"""A ring of eight sonars in a drawn office: echoes get their places, drift is taken out."""

import math

import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.ranging.segment_index import distances
from robotctl.estimation.ranging.sonar_cones import SonarCones
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.estimation.ranging.wall_echoes import WallEchoes
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, honest, match_pair
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.local_scans.gathered import scan_of_points
from robotctl.estimation.slam.local_scans.sonar import SOURCE, SonarScans, echo_direction
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarReading
from robotctl.model.sensors.sonar_mounts import mount_rows
from robotctl.model.wall_map import WallMap
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, drifting, scan_of

MOUNTS = load_robot(find_file("diff_drive")).sonar
AROUND = np.radians(np.arange(-180.0, 180.0, 2.0))
HALF_BEAM = math.radians(12.5)
OPEN = math.radians(35.0)
TWICE = [(1.0, 1.0), (13.0, 1.0), (13.0, 9.0), (1.0, 9.0)] * 2 + [(1.0, 1.0)]

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def heard(walls, poses, rng):
    """Return what the ring reads at each pose: echoes of straight walls, one in twenty wrong."""
    config = SonarModelConfig()
    echoes = WallEchoes(
        WallMap(walls.reshape(-1, 4)),
        SonarCones(
            mount_rows(MOUNTS), math.radians(config.beam_deg),
            math.radians(config.max_incidence_deg), config.max_range_m,
        ),
    )  # fmt: skip
    rows = np.array([(each.x_m, each.y_m, each.theta_rad) for each in poses])
    ranges = echoes.ranges(rows, np.arange(len(MOUNTS)))
    ranges = ranges + 0.01 * rng.standard_normal(ranges.shape)
    wrong = rng.random(ranges.shape) < 0.05
    ranges[wrong] = rng.uniform(0.2, config.max_range_m, np.count_nonzero(wrong))
    return [SonarReading(50_000_000 * k, tuple(row)) for k, row in enumerate(ranges.tolist())]


def scans_of(readings, odometry):
    maker = SonarScans(MOUNTS, SonarModelConfig())
    return [scan for pair in zip(readings, odometry, strict=True) for scan in maker.add(*pair)]


@pytest.mark.parametrize("off_deg", [-10.0, -3.0, 0.0, 7.0])
def test_readings_on_the_way_tell_in_which_direction_the_wall_stands(off_deg):
    towards = math.radians(90.0 + off_deg)
    x = np.linspace(-0.2, 0.2, 15)
    ranges = 1.5 - math.cos(towards) * x
    rows = np.column_stack([x, np.zeros(15), np.full(15, math.radians(90.0)), ranges])
    assert echo_direction(rows[7], rows, HALF_BEAM, OPEN) == pytest.approx(towards, abs=0.02)


@pytest.mark.parametrize("turning", [0.0, 0.6])
@pytest.mark.parametrize("wall_deg", [62.0, 75.0, 90.0, 118.0])
def test_a_wall_aslant_is_heard_on_the_edge_of_the_cone(wall_deg, turning):
    normal = math.radians(wall_deg)
    x = np.linspace(-0.2, 0.2, 15)
    headings = math.radians(90.0) + turning * x
    rays = headings[:, None] + np.linspace(-HALF_BEAM, HALF_BEAM, 2001)
    ranges = (2.0 - math.cos(normal) * x)[:, None] / np.cos(rays - normal)
    rows = np.column_stack([x, np.zeros(15), headings, ranges.min(axis=1)])
    heard = rays[7, np.argmin(ranges[7])]
    assert echo_direction(rows[7], rows, HALF_BEAM, OPEN) == pytest.approx(heard, abs=0.03)


def test_an_echo_that_no_other_bears_out_has_no_place():
    x = np.linspace(-0.2, 0.2, 15)
    rows = np.column_stack([x, np.zeros(15), np.full(15, math.radians(90.0)), np.full(15, 1.5)])
    rows[7, 3] = 0.8
    assert echo_direction(rows[7], rows, HALF_BEAM, OPEN) is None


def test_what_is_nearer_hides_what_is_behind_it_and_a_lonely_echo_is_none():
    near, behind = np.full((3, 2), (1.0, 0.01)), np.full((3, 2), (2.0, 0.02))
    scan = scan_of_points(np.concatenate([near, behind, [[0.0, 1.0]]]), 0, 4.0)
    assert np.flatnonzero(np.isfinite(scan.ranges_m)).tolist() == [90]
    assert scan.ranges_m[90] == pytest.approx(1.0, abs=0.001)


def test_a_scan_of_nothing_has_no_echo():
    assert not np.isfinite(scan_of_points(np.empty((0, 2)), 0, 4.0).ranges_m).any()


def test_scans_show_the_walls_where_they_are():
    rng = np.random.default_rng(1)
    poses = along(TWICE[:3], step_m=0.05, turn_rad=0.05)
    scans = scans_of(heard(OFFICE, poses, rng), poses)
    points = np.concatenate([moved(each.odometry, each.scan.points_base()) for each in scans])
    off = np.sort(distances(points, OFFICE.reshape(-1, 4)).min(axis=1))
    assert len(points) > 1500
    assert off[len(off) // 2] < 0.02
    assert off[int(0.9 * len(off))] < 0.12


def test_rounds_through_an_office_close_and_take_out_the_drift():
    rng = np.random.default_rng(2)
    poses = along(TWICE, step_m=0.05, turn_rad=0.05)
    odometry = drifting(poses, rng, bias_rad=0.008)
    mapper = SlamMapper(SOURCE.config)
    scans = scans_of(heard(OFFICE, poses, rng), odometry)
    places = [mapper.add(each.scan, each.odometry) for each in scans]
    mapper.finish()
    true = np.array([(each.x_m, each.y_m) for each in poses])[
        [each.scan.stamp_ns // 50_000_000 for each in scans]
    ]

    def ape_m(made):
        own = np.array([(each.x_m, each.y_m) for each in made])
        off = moved(align(own, true), own) - true
        return np.sqrt(np.mean(np.sum(off**2, axis=1)))

    dead_reckoned_m = ape_m([each.odometry for each in scans])
    assert dead_reckoned_m > 1.0
    assert ape_m([mapper.back_end.pose(p.keyframe) @ p.pose for p in places]) < 0.35
    assert any(not each.reason for each in mapper.loops.log)
    for each in mapper.back_end.links:
        ways_m = [mapper.keyframes[k].travelled_m for k in (each.first, each.second)]
        assert not each.is_loop or ways_m[1] - ways_m[0] > SOURCE.config.stretch_m


def test_a_match_along_a_corridor_says_nothing_of_the_place_along_it():
    c, s = math.cos(0.4), math.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    covariance = np.linalg.inv(honest(turn @ np.diag([800.0, 1e4, 3e3]) @ turn.T))
    along_it, across_it = np.diag(turn.T @ covariance @ turn)[:2]
    assert along_it > 0.9
    assert across_it < 0.06**2


def test_a_match_in_a_room_says_where_the_robot_is():
    covariance = np.linalg.inv(honest(np.diag([5e3, 1e4, 3e3])))
    assert np.sqrt(covariance[:2, :2].trace()) < 0.1


def test_two_stretches_of_a_corridor_stay_where_they_are_along_it():
    x = np.arange(-20.0, 20.0)
    ledges = np.repeat(np.stack([x, x + 1.0], axis=1)[..., None], 2, axis=2)
    ledges[..., 1] = 1.07 + 0.03 * (np.arange(len(x)) % 2)[:, None]
    walls = np.concatenate([ledges, [1.0, -1.0] * ledges])
    rng = np.random.default_rng(1)
    old_at, new_at = SE2(0.3, 0.2, 0.05), SE2(1.0, -0.3, 3.0)
    scans = [scan_of(walls, at, rng, reach_m=4.0, angles=AROUND) for at in (old_at, new_at)]
    first, second = (Keyframe(scan, 0.0) for scan in scans)
    start = old_at.inverse() @ SE2(new_at.x_m + 0.4, new_at.y_m + 0.05, new_at.theta_rad + 0.03)
    found = old_at @ match_pair(first, second, start, SOURCE.config, 0.5).pose
    assert found.x_m == pytest.approx(new_at.x_m + 0.4, abs=0.03)
    assert found.y_m == pytest.approx(new_at.y_m, abs=0.02)
    assert found.theta_rad == pytest.approx(new_at.theta_rad, abs=0.01)


def test_loops_of_scans_that_share_echoes_count_as_often_as_echoes_are_there():
    by_wheels, by_loop = SE2(1.0, 0.0, 0.0), SE2(1.2, 0.0, 0.0)
    information = np.diag([100.0, 100.0, 400.0])
    times = round(SOURCE.config.shared**2)
    back_end = BackEnd(times)
    for pose in (SE2(), by_wheels):
        back_end.add(pose)
    back_end.link(KeyframeLink(0, 1, by_wheels, information))
    for _ in range(times):
        back_end.link(KeyframeLink(0, 1, by_loop, information, is_loop=True))
    back_end.refine()
    assert times == 16
    assert back_end.pose(1).x_m == pytest.approx(1.1, abs=1e-6)
