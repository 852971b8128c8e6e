"""A map by sonars is gone on with: the robot is expected where it was last, more or less."""

from dataclasses import replace

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.known_places import Known
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.motion import OdometryAnchor, PredictedMotion, ScanPose
from robotctl.estimation.slam.keyframes.saved_map import restored, whole_map
from robotctl.estimation.slam.local_scans.sonar import SOURCE
from robotctl.estimation.slam.local_scans.source import UNKNOWN_WHEELS
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, drifting
from tests.estimation.slam.local_scans.test_sonar import TWICE, heard, scans_of

LIVE = replace(SOURCE.config, is_live=True)
POSES = along(TWICE, step_m=0.05, turn_rad=0.05)
HALF = int(0.55 * len(POSES))
"""A little more than one round."""
AWAY = SE2(0.3, 0.25, 0.1)
"""What the robot was pushed by while nobody looked: 0.4 m and 0.1 rad."""

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def driven(poses, seed):
    """Return the scans of a drive with its own odometry, and where that ends."""
    rng = np.random.default_rng(seed)
    odometry = drifting(poses, rng, bias_rad=0.002)
    return scans_of(heard(OFFICE, poses, rng), odometry), odometry[-1]


@pytest.fixture(scope="module")
def record():
    """A map of one round, with the robot's place at its end."""
    mapper = SlamMapper(LIVE)
    scans, end = driven(POSES[:HALF], 1)
    for each in scans:
        mapper.add(each.scan, each.odometry)
    place = mapper.place.pose @ scans[-1].odometry.inverse() @ end
    return whole_map(mapper, "sonar", POSES[0], (mapper.place.keyframe, place))


def gone_on(record, inside, odometry, *, is_another):
    """Return a mapper that goes on with a map, with the robot at a pose in the last keyframe."""
    mapper = SlamMapper(LIVE)
    saved = restored([record])
    mapper.resume(saved, is_there=True)
    place = ScanPose(0, saved.place[0], saved.place[1] @ inside)
    mapper.restart_segment(place, odometry, is_another=is_another)
    return mapper


def off(mapper, pose):
    found = (POSES[0] @ mapper.pose).inverse() @ pose
    return np.hypot(found.x_m, found.y_m), abs(found.theta_rad)


def test_a_robot_that_was_pushed_comes_back_to_its_place_where_it_was_before(record):
    mapper = gone_on(record, AWAY, SE2(), is_another=True)
    before = len(mapper.keyframes)
    assert not mapper.is_lost
    errors, doubts_m = [], []
    for each in driven(POSES[HALF:], 2)[0]:
        mapper.add(each.scan, each.odometry)
        errors.append(off(mapper, POSES[HALF + each.scan.stamp_ns // 50_000_000]))
        doubts_m.append(np.sqrt(np.trace(mapper.covariance[:2, :2])))
    first_m, first_rad = errors[0]
    assert 0.25 < first_m < doubts_m[0]
    assert first_rad > 0.08
    at_end = np.array(errors[-20:])
    assert at_end.max(axis=0) == pytest.approx((0.0, 0.0), abs=0.15)
    across = [each for each in mapper.back_end.links if each.first < before <= each.second]
    first = across.pop(0)
    assert np.sqrt(np.linalg.inv(first.information)[0, 0]) > 0.5
    # No wall that goes on, nothing but matched scans holds the two drives together.
    assert across
    assert all(each.is_loop for each in across)


def test_a_robot_whose_odometry_lived_on_is_as_sure_as_odometry_is(record):
    scans, end = driven(POSES[HALF : HALF + 60], 2)
    mapper = gone_on(record, SE2(), SE2(), is_another=False)
    last, before_m = len(mapper.keyframes) - 1, off(mapper, POSES[HALF])[0]
    for each in scans:
        mapper.add(each.scan, each.odometry)
    link = next(each for each in mapper.back_end.links if each.second == last + 1)
    sigma_m, sigma_rad = np.sqrt(np.diag(np.linalg.inv(link.information)))[[0, 2]]
    way_m = np.hypot(link.pose.x_m, link.pose.y_m)
    assert UNKNOWN_WHEELS.sigma_m(way_m, 0.0) <= sigma_m < 2.0 * UNKNOWN_WHEELS.sigma_m(way_m, 1.0)
    assert sigma_rad < 2.0 * UNKNOWN_WHEELS.sigma_rad(way_m, 1.0)
    assert np.hypot(end.x_m, end.y_m) > 1.0
    after_m, _ = off(mapper, POSES[HALF + scans[-1].scan.stamp_ns // 50_000_000])
    assert after_m < before_m + 0.1


def test_a_robot_that_goes_round_and_round_keeps_a_map_of_one_size():
    poses = along([*TWICE[:8], *TWICE[:8], TWICE[0]], step_m=0.05, turn_rad=0.05)
    mapper, sizes, errors_m = SlamMapper(LIVE), [], []
    for each in driven(poses, 3)[0]:
        mapper.add(each.scan, each.odometry)
        sizes.append(len(mapper.keyframes))
        errors_m.append(off(mapper, poses[each.scan.stamp_ns // 50_000_000])[0])
    rounds = np.array_split(sizes, 4)
    assert rounds[0][-1] > 60
    assert rounds[3][-1] - rounds[1][-1] < 0.1 * rounds[0][-1]
    # It knows its place on the map as well as when it closed the first loops.
    assert max(np.array_split(errors_m, 4)[3]) < max(np.array_split(errors_m, 4)[1]) + 0.1


def test_a_known_place_is_where_odometry_and_match_say_by_what_each_is_worth():
    variances = np.array([0.01, 0.01, 0.002])
    match = Known(3, SE2(1.0, 2.0, 0.5), 0.0, is_young=False, information=np.diag(3.0 / variances))
    known, covariance = match.weighed(match.pose @ SE2(0.2, -0.1, 0.0), np.diag(variances))
    inside = match.pose.inverse() @ known.pose
    assert (inside.x_m, inside.y_m, inside.theta_rad) == pytest.approx((0.05, -0.025, 0.0))
    np.testing.assert_allclose(covariance, np.diag(variances / 4.0), atol=1e-12)
    assert match.weighed(match.pose @ SE2(0.6, 0.0, 0.0), np.diag(variances)) is None


def test_a_doubted_heading_moves_what_comes_after_it():
    """Against many robots that were turned by chance before they drove on."""
    rng, odometry = np.random.default_rng(4), SE2(2.0, 0.0, 0.3)
    kept = OdometryAnchor(SE2(0.2, 0.1, 0.5), SE2(), PredictedMotion(SE2(), 0.1, 0.17))
    known = kept.moved_to(odometry, UNKNOWN_WHEELS)
    ends = [
        kept.pose @ SE2(*(rng.normal(size=3) * (0.1, 0.1, 0.17)).tolist()) @ odometry
        for _ in range(2000)
    ]
    offs = [known.motion.inverse() @ each for each in ends]
    spread = np.std([(each.x_m, each.y_m, each.theta_rad) for each in offs], axis=0)
    wheels_m = UNKNOWN_WHEELS.sigma_m(2.0, 0.3)
    assert known.sigma_m == pytest.approx(np.hypot(spread[:2].max(), wheels_m), rel=0.1)
    assert known.sigma_rad == pytest.approx(spread[2], rel=0.1)
