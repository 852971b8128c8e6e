"""How well the robot knows its place on its own map: against dense algebra and the true drive."""

import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.estimation.slam.keyframes.config import CalibratedWheels, KeyframeConfig
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.model.drives.motion_noise import MotionNoise, added_covariance
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, drifting, scan_of

LIVE = KeyframeConfig(is_live=True)
FULL_CIRCLE = np.radians(np.arange(-180.0, 180.0, 2.0))

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def test_the_marginal_of_a_keyframe_is_that_of_the_dense_graph():
    """Oracle: inverse of J^T Omega J, with J by differences of relative poses."""
    rng = np.random.default_rng(3)
    poses = [SE2(), SE2(1.0, 0.2, 0.5), SE2(1.6, 1.1, 1.4), SE2(0.8, 1.9, 2.9)]
    pairs = [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2)]
    graph, information = BackEnd(), {}
    for each in poses:
        graph.add(each)
    for first, second in pairs:
        root = rng.normal(size=(3, 3)) + 4.0 * np.eye(3)
        information[first, second] = root @ root.T
        exact = poses[first].inverse() @ poses[second]
        graph.link(KeyframeLink(first, second, exact, root @ root.T))
    graph.refine()

    def residual(errors, first, second):
        ends = [poses[k] @ SE2.exp(*errors[k].tolist()) for k in (first, second)]
        exact = poses[first].inverse() @ poses[second]
        return np.array((exact.inverse() @ ends[0].inverse() @ ends[1]).log())

    H, step = np.zeros((9, 9)), 1e-6
    for first, second in pairs:
        J = np.zeros((3, 9))
        for column in range(9):
            errors = np.zeros((4, 3))
            errors[1 + column // 3, column % 3] = step
            J[:, column] = (residual(errors, first, second) - residual(-errors, first, second)) / (
                2.0 * step
            )
        H += J.T @ information[first, second] @ J
    dense = np.linalg.inv(H)
    for number in (1, 3, 2):
        at = slice(3 * number - 3, 3 * number)
        np.testing.assert_allclose(graph.marginal(number), dense[at, at], rtol=1e-5, atol=1e-9)
    assert not graph.marginal(0).any()


def test_a_link_that_closes_a_loop_makes_the_keyframe_more_certain():
    graph = BackEnd()
    for x in (0.0, 1.0, 2.0):
        graph.add(SE2(x, 0.0, 0.0))
    for first, second in ((0, 1), (1, 2)):
        graph.link(KeyframeLink(first, second, SE2(1.0, 0.0, 0.0), 100.0 * np.eye(3)))
    graph.update()
    before = graph.marginal(2)
    graph.close([KeyframeLink(0, 2, SE2(2.0, 0.0, 0.0), 100.0 * np.eye(3), is_loop=True)])
    after = graph.marginal(2)
    assert np.linalg.eigvalsh(before - after).min() > 0.0


def nees(seed, *, sigma_m=0.01, long_m=0.005):
    """NEES along the outer round of the office, of the pose in the frame of its start, (n,)."""
    rng = np.random.default_rng(seed)
    poses = along([(1.0, 1.0), (13.0, 1.0), (13.0, 9.0), (1.0, 9.0), (1.0, 2.0)])
    mapper = SlamMapper(LIVE)
    found = []
    for number, (pose, odometry) in enumerate(zip(poses, drifting(poses, rng), strict=True)):
        # A lidar that reads 5 mm long, as real ones do, beside its noise.
        stamp_ns = number * 500_000_000
        scan = scan_of(OFFICE, pose, rng, sigma_m=sigma_m, stamp_ns=stamp_ns, angles=FULL_CIRCLE)
        mapper.add(replace(scan, ranges_m=scan.ranges_m + long_m), odometry)
        off = np.array(((poses[0].inverse() @ pose).inverse() @ mapper.pose).log())
        found.append(float(off @ np.linalg.solve(mapper.covariance, off)))
    return np.array(found[1:])


def test_nees_of_the_pose_along_new_ground_is_not_above_its_bounds():
    values = [nees(seed) for seed in range(4)]
    above = np.concatenate(values) > chi2_bounds(3, 0.95)[1]
    assert np.mean(above) < 0.05
    assert np.mean(np.concatenate(values)) < 3.0
    assert np.mean(np.concatenate(values)) > 0.1


@pytest.mark.parametrize("sigma_m", [0.01, 0.03])
def test_the_pose_is_as_sure_as_its_lidar_is_exact(sigma_m):
    """NEES against the true drive, by a good lidar and by a poor one."""
    values = np.concatenate([nees(seed, sigma_m=sigma_m, long_m=0.0) for seed in range(3)])
    low, high = chi2_bounds(3, 0.95)
    assert np.mean((values > low) & (values < high)) > 0.85
    assert 0.7 < np.mean(values) < 3.0


@pytest.mark.parametrize("distance_m", [0.05, 0.5, 3.0])
def test_noise_of_calibrated_wheels_is_that_of_the_law_of_motion(distance_m):
    """Oracle: the covariance of an arc, integrated along it."""
    noise = MotionNoise(0.02, 0.03, 0.04)
    wheels = CalibratedWheels(noise)
    Q = added_covariance(SE2(), distance_m, 0.0, noise)
    assert wheels.sigma_rad(distance_m, 0.0) ** 2 == pytest.approx(Q[2, 2])
    assert wheels.sigma_m(distance_m, 0.0) ** 2 == pytest.approx(max(Q[0, 0], Q[1, 1]))
    on_the_spot = added_covariance(SE2(), 0.0, 0.7, noise)
    assert wheels.sigma_rad(0.0, 0.7) ** 2 == pytest.approx(on_the_spot[2, 2])


def test_a_robot_that_only_localises_itself_is_as_sure_as_its_match():
    """What a fixed map is off is none of the robot's: it stands right where the map has it."""
    pose = along([(1.0, 1.0), (13.0, 1.0)])
    rng = np.random.default_rng(1)
    mapper = SlamMapper(LIVE)
    for number, each in enumerate(pose):
        mapper.add(scan_of(OFFICE, each, rng, stamp_ns=number * 500_000_000), SE2(0.3 * number))
    grown = mapper.covariance
    mapper.config = replace(LIVE, is_fixed=True)
    assert math.sqrt(grown[0, 0]) > math.sqrt(mapper.covariance[0, 0])
    np.testing.assert_array_equal(mapper.covariance, mapper.robot.covariance)
