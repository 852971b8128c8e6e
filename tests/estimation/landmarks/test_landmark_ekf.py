"""Localisation by landmarks: models, self-calibration, learned noise, and starting anew."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.kalman.adaptive_noise import AdaptiveVariance
from robotctl.estimation.kalman.consistency import pose_nees, share_inside
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.fix import SeenLandmark, pose_from_landmarks
from robotctl.estimation.landmarks.localisation import CountedOdometry, localise_by_landmarks
from robotctl.estimation.landmarks.models import OdometryReading, S, moved, sighting
from robotctl.estimation.landmarks.smoothing import LandmarkSmoother, smoothed
from robotctl.logs.formats.mrclam_log import read_mrclam
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from tests.estimation.landmarks.landmark_drives import LANDMARKS, simulated_drive, start_near

# The drives have the odometry's noise of the defaults; camera and map are exact but for theirs.
EXACT = LandmarkConfig(wander_sigma_rad=1e-4, correlation=1.0, map_sigma_m=0.0, map_sigma_rad=0.0)


def numerical(function, x, step=1e-6):
    columns = []
    for i in range(len(x)):
        up, down = x.copy(), x.copy()
        up[i] += step
        down[i] -= step
        columns.append((function(up) - function(down)) / (2.0 * step))
    return np.stack(columns, axis=-1)


def any_state(seed):
    rng = np.random.default_rng(seed)
    mean, sigma = LandmarkConfig().calibration()
    x = mean + sigma * rng.uniform(-1.0, 1.0, len(mean))
    x[:3] = rng.uniform(-2.0, 2.0, 3)
    return x


@given(
    seed=st.integers(0, 10**6),
    d=st.floats(0.01, 0.3),
    a=st.floats(0.01, 0.5),
    sign=st.sampled_from([-1, 1]),
)
def test_the_jacobian_of_the_motion_is_the_numerical_one(seed, d, a, sign):
    x = any_state(seed)
    begin = OdometryReading(1.0, 2.0, 0.3, -0.2)
    end = OdometryReading(1.0 + d, 2.0 + sign * a, 0.1, 0.4)

    def after(p):
        # a delay moves the readings themselves
        late = p[S.DELAY] - x[S.DELAY]
        earlier = [
            OdometryReading(
                each.distance_m - late * each.v_m_s,
                each.turn_rad - late * each.omega_rad_s,
                each.v_m_s,
                each.omega_rad_s,
            )
            for each in (begin, end)
        ]
        return moved(p, *earlier)[0]

    _, F, G, distance, turn = moved(x, begin, end)
    np.testing.assert_allclose(F, numerical(after, x), atol=1e-7)

    def end_of(p):
        half = x[S.THETA] + 0.5 * p[1]
        return np.array([p[0] * math.cos(half), p[0] * math.sin(half), p[1]])

    np.testing.assert_allclose(G, numerical(end_of, np.array([distance, turn])), atol=1e-8)


@given(seed=st.integers(0, 10**6))
def test_the_jacobian_of_a_sighting_is_the_numerical_one(seed):
    x = any_state(seed)
    landmark = (5.0, 4.0)
    _, H, _ = sighting(x, landmark)
    np.testing.assert_allclose(H, numerical(lambda p: sighting(p, landmark)[0], x), atol=1e-6)


def test_a_calibrated_camera_reads_distance_and_bearing_and_its_depth_share_tells_depth():
    x = np.zeros(len(S))
    x[:3] = 1.0, 2.0, 0.3
    distance, bearing = sighting(x, (3.0, 3.0))[0]
    assert distance == pytest.approx(math.hypot(2.0, 1.0))
    assert bearing == pytest.approx(math.atan2(1.0, 2.0) - 0.3)
    x[S.DEPTH_SHARE] = 1.0
    assert sighting(x, (3.0, 3.0))[0][0] == pytest.approx(distance * math.cos(bearing))


def test_counted_odometry_is_the_same_from_velocities_and_from_poses():
    stamps_ns = np.arange(0, 4_000_000_001, 500_000_000)
    twists = np.array([[0.2, 0.1 * k] for k in range(len(stamps_ns))])
    poses = [SE2()]
    for v, omega in twists[:-1]:
        poses.append(arc(poses[-1], 0.5 * v, 0.5 * omega))
    track = np.array([[p.x_m, p.y_m, p.theta_rad] for p in poses])
    by_velocity = CountedOdometry(Recording("a", twist_stamps_ns=stamps_ns, twists=twists))
    by_pose = CountedOdometry(Recording("b", odometry=Trajectory(stamps_ns, track)))
    for t in (0, 700_000_000, 3_900_000_000, 9_000_000_000):
        one, other = by_velocity.at(t, 0.1), by_pose.at(t, 0.1)
        assert one.distance_m == pytest.approx(other.distance_m, abs=1e-9)
        assert one.turn_rad == pytest.approx(other.turn_rad, abs=1e-9)
    assert by_velocity.at(700_000_000, 0.1).distance_m == pytest.approx(0.12)
    assert by_velocity.at(700_000_000, 0.1).omega_rad_s == pytest.approx(0.1)


def test_a_recording_without_motion_is_refused_by_name():
    with pytest.raises(ValueError, match="still life: no motion"):
        CountedOdometry(Recording("still life"))


@given(x=st.floats(-5, 5), y=st.floats(-5, 5), theta=st.floats(-3, 3))
def test_exact_sightings_give_the_exact_pose(x, y, theta):
    pose = SE2(x, y, theta)
    seen = []
    for landmark in ((3.0, 1.0), (-1.0, 4.0), (0.5, -2.0)):
        bx, by = pose.inverse().apply(*landmark)
        seen.append(SeenLandmark(0, landmark, math.hypot(bx, by), math.atan2(by, bx)))
    found = pose_from_landmarks(seen)
    assert found is not None
    assert (found[0].x_m, found[0].y_m) == pytest.approx((x, y), abs=1e-9)
    assert math.remainder(found[0].theta_rad - theta, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.eigvalsh(found[1]).min() > 0.0


def test_one_landmark_gives_no_pose_and_one_wrong_sighting_of_five_is_left_out():
    one = SeenLandmark(0, (3.0, 1.0), 2.0, 0.1)
    assert pose_from_landmarks([one, one, one]) is None
    assert pose_from_landmarks([]) is None
    seen = []
    for x, y in list(LANDMARKS.values())[:5]:
        seen.append(SeenLandmark(0, (x, y), math.hypot(x, y), math.atan2(y, x)))
    seen[2] = SeenLandmark(0, seen[2].landmark_world, 1.0, 3.0)
    found = pose_from_landmarks(seen)
    assert found is not None
    assert math.hypot(found[0].x_m, found[0].y_m) < 1e-9


def test_a_variance_is_learned_and_a_wild_value_hardly_moves_it():
    rng = np.random.default_rng(3)
    variance = AdaptiveVariance(20.0, 1e9)
    assert variance.factor == 1.0
    for value in 2.0 * rng.standard_normal(4000):
        variance.add(value**2)
    assert variance.factor == pytest.approx(4.0, rel=0.2)
    before = variance.factor
    variance.add(1e9)
    assert variance.factor < 1.01 * before
    variance.fade(1e12)
    assert variance.factor == pytest.approx(1.0)


def scored(recording, estimates):
    """Errors in position, NEES, and the share LOCALISED more than 1 m or 30 deg off."""
    errors, nees, wrong = [], [], []
    for each in estimates:
        truth = recording.reference.at(each.stamp_ns)
        errors.append(math.hypot(each.pose.x_m - truth.x_m, each.pose.y_m - truth.y_m))
        turned = math.remainder(each.pose.theta_rad - truth.theta_rad, math.tau)
        is_off = errors[-1] > 1.0 or abs(turned) > math.radians(30.0)
        wrong.append(is_off and each.status is LocalisationStatus.LOCALISED)
        nees.append(pose_nees(each, truth))
    return np.array(errors), np.array(nees), float(np.mean(wrong))


def both_ways(recording, config, start):
    """Estimates of the filter, and those by all that was seen."""
    smoother, online = LandmarkSmoother(config), []
    for step in localise_by_landmarks(recording, config, start):
        online.append(step.estimate)
        smoother.add(step)
    return online, smoothed(recording, config, start, smoother)


def blind(recording, *stretches):
    """The recording without the sightings of some stretches, (begin, end) [s]."""
    seen = tuple(
        each
        for each in recording.sightings
        if not any(begin <= 1e-9 * each.stamp_ns < end for begin, end in stretches)
    )
    return replace(recording, sightings=seen)


def test_a_blind_robot_says_that_it_guesses_and_what_it_sees_later_tells_where_it_was():
    # blind from the start, when the odometry is not yet calibrated: 5 % long, turns 8 % short
    recording = blind(simulated_drive(6), (0.0, 60.0))
    online, after = both_ways(recording, EXACT, start_near(recording, 6))
    errors, _, wrong = scored(recording, online)
    assert errors.max() > 0.7
    assert wrong == 0.0
    assert any(each.status is LocalisationStatus.SEARCHING for each in online)
    smooth_errors, _, wrong = scored(recording, after)
    assert smooth_errors.max() < 0.5 * errors.max()
    assert wrong == 0.0


def test_nees_of_the_smoothed_drive_keeps_its_bounds_over_seeded_blind_drives():
    nees = []
    for seed in range(4):
        recording = blind(simulated_drive(seed, seconds=80.0), (20.0, 50.0))
        online, after = both_ways(recording, EXACT, start_near(recording, seed))
        assert [each.stamp_ns for each in after] == [each.stamp_ns for each in online]
        nees.append(scored(recording, after)[1])
    assert share_inside(np.concatenate(nees), 3) > 0.85
    assert np.mean([each.mean() for each in nees]) < 3.0 + 3.0 * math.sqrt(6.0 / len(nees))


def test_the_backward_pass_conditions_the_whole_drive_on_all_that_was_seen():
    """The oracle is the joint Gaussian of all states of the linearised drive, dense."""
    recording = simulated_drive(7, seconds=5.0)
    smoother, steps = LandmarkSmoother(EXACT), []
    for step in localise_by_landmarks(recording, EXACT, start_near(recording, 7)):
        smoother.add(step)
        steps.append((step.made, step.ekf.x, step.ekf.P))
    n, count = len(S), len(steps)
    _, x, P = steps[0]
    mean, joint, maps, told = [x], np.zeros((n * count, n * count)), [], []
    joint[:n, :n] = P
    for k in range(1, count):
        (made, after, P_after), (_, before, P_before) = steps[k], steps[k - 1]
        now, last = slice(k * n, (k + 1) * n), slice((k - 1) * n, k * n)
        mean.append(made.x + made.F @ (mean[-1] - before))
        joint[now, : k * n] = made.F @ joint[last, : k * n]
        joint[: k * n, now] = joint[now, : k * n].T
        joint[now, now] = made.F @ joint[last, last] @ made.F.T + made.Q
        # what the sightings said, as unit measurements: the information that the step gained
        predicted = made.F @ P_before @ made.F.T + made.Q
        scale = np.sqrt(np.diag(predicted))
        unit = np.outer(scale, scale)
        P_after, predicted = P_after / unit, predicted / unit
        values, vectors = np.linalg.eigh(np.linalg.inv(P_after) - np.linalg.inv(predicted))
        kept = values > 1e-6
        rows = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
        b = np.linalg.solve(P_after, after / scale) - np.linalg.solve(predicted, made.x / scale)
        told.append((rows @ b) / values[kept])
        whole = np.zeros((kept.sum(), n * count))
        whole[:, now] = rows / scale
        maps.append(whole)
    A, z, m = np.concatenate(maps), np.concatenate(told), np.concatenate(mean)
    assert len(z) > 20  # sightings
    gain = np.linalg.solve(A @ joint @ A.T + np.eye(len(z)), A @ joint).T
    expected = (m + gain @ (z - A @ m)).reshape(count, n)
    np.testing.assert_allclose(smoother.states(), expected, atol=1e-6)
    wide = joint - gain @ A @ joint
    for k, each in enumerate(smoother.estimates()):
        at = slice(k * n, k * n + 3)
        np.testing.assert_allclose(each.covariance, wide[at, at], atol=1e-8)


def followed(recording, config, start):
    """Errors in position, NEES, and the last step."""
    errors, nees = [], []
    for step in localise_by_landmarks(recording, config, start):
        truth = recording.reference.at(step.estimate.stamp_ns)
        pose = step.estimate.pose
        errors.append(math.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m))
        nees.append(pose_nees(step.estimate, truth))
    return np.array(errors), np.array(nees), step


@pytest.mark.parametrize("depth", [0.0, 1.0])
def test_what_is_wrong_with_odometry_and_camera_is_found_within_its_stated_error(depth):
    recording = simulated_drive(1, depth=depth)
    errors, _, step = followed(recording, EXACT, start_near(recording, 1))
    assert errors[-500:].mean() < 0.05
    truth = np.zeros(len(S))
    truth[[S.DISTANCE_SCALE, S.LEFT_SCALE, S.RIGHT_SCALE]] = 0.05, -0.08, -0.08
    truth[[S.DELAY, S.DEPTH_SHARE, S.AXIS, S.RANGE_SCALE]] = 0.15, depth, 0.015, 0.03
    off = np.abs(step.ekf.x - truth)[S.DISTANCE_SCALE : S.WANDER]
    sigma = step.ekf.sigma[S.DISTANCE_SCALE : S.WANDER]
    assert np.all(off < 3.0 * sigma)
    assert step.ekf.sigma[S.DEPTH_SHARE] < 0.1
    assert step.ekf.sigma[S.DELAY] < 0.05


def test_nees_keeps_its_bounds_over_seeded_drives():
    nees = []
    for seed in range(5):
        recording = simulated_drive(seed, seconds=80.0)
        nees.append(followed(recording, EXACT, start_near(recording, seed))[1])
    assert share_inside(np.concatenate(nees), 3) > 0.85
    assert np.mean([each[-1] for each in nees]) < 3.0 + 3.0 * math.sqrt(6.0 / len(nees))


def test_the_noise_of_the_sightings_is_learned():
    recording = simulated_drive(2, range_sigma=0.15)
    _, _, step = followed(recording, EXACT, start_near(recording, 2))
    distance = 3.0  # about what is seen from within the ring
    guess = EXACT.sighting_range_sigma_m + EXACT.sighting_range_sigma_m_per_m * distance
    assert step.ekf.noise_factors[0] * guess == pytest.approx(0.15, rel=0.4)


def test_the_noise_of_a_motion_that_is_rougher_than_guessed_is_learned():
    recording = simulated_drive(2, motion_noise=4.0)
    _, nees, step = followed(recording, EXACT, start_near(recording, 2))
    assert step.ekf.motion_noise_factor == pytest.approx(4.0, rel=0.3)
    assert share_inside(nees[-1000:], 3) > 0.8
    _, _, step = followed(simulated_drive(2), EXACT, start_near(recording, 2))
    assert step.ekf.motion_noise_factor < 1.3


def test_outliers_do_not_spoil_the_calibration():
    recording = simulated_drive(3, outliers=0.1)
    errors, _, step = followed(recording, LandmarkConfig(), start_near(recording, 3))
    assert errors[-500:].mean() < 0.1
    assert step.ekf.x[S.DEPTH_SHARE] == pytest.approx(1.0, abs=0.3)
    assert step.ekf.restarts == 0


def test_a_robot_carried_away_is_said_to_be_lost_and_finds_itself_again():
    recording = simulated_drive(4, carried=(100.0, SE2(-1.0, 1.0, 2.0)))
    said, errors = [], []
    smoother = LandmarkSmoother(LandmarkConfig())
    for step in localise_by_landmarks(recording, LandmarkConfig(), start_near(recording)):
        smoother.add(step)
        truth = recording.reference.at(step.estimate.stamp_ns)
        pose = step.estimate.pose
        errors.append(math.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m))
        said.append(step.estimate.status)
    assert step.ekf.restarts >= 1
    assert max(errors) > 1.0
    assert np.mean(errors[-300:]) < 0.15
    assert said[-1] is LocalisationStatus.LOCALISED
    assert step.ekf.x[S.DEPTH_SHARE] == pytest.approx(1.0, abs=0.3)
    # nothing of the place after it is carried over to the drive before
    after = smoothed(recording, LandmarkConfig(), start_near(recording), smoother)
    away = scored(recording, after)[0]
    assert np.mean(away[:900]) < 0.1
    assert np.mean(away[-300:]) < 0.1


def test_a_start_that_is_quite_wrong_is_found_out():
    recording = simulated_drive(5)
    wrong = PoseEstimate(
        0, SE2(2.0, -2.0, 2.5), np.diag([0.01, 0.01, 0.01]), LocalisationStatus.LOCALISED
    )
    errors, _, step = followed(recording, LandmarkConfig(), wrong)
    assert step.ekf.restarts >= 1
    assert errors[-500:].mean() < 0.1


def test_settings_out_of_range_name_themselves():
    with pytest.raises(ValueError, match=r"correlation: 0\.5 found"):
        replace(LandmarkConfig(), correlation=0.5)
    with pytest.raises(ValueError, match=r"delay_sigma_s: 0\.0 found"):
        replace(LandmarkConfig(), delay_sigma_s=0.0)


@pytest.mark.recordings("mrclam/MRCLAM_Dataset7")
@pytest.mark.parametrize("robot", [1, 2])
def test_real_robots_are_followed_to_a_decimetre_and_know_how_well(recordings: Path, robot):
    recording = read_mrclam(recordings / "mrclam" / "MRCLAM_Dataset7", robot)
    begin_ns = int(recording.twist_stamps_ns[0])
    start = PoseEstimate(
        begin_ns,
        recording.reference.at(begin_ns),
        np.diag([0.25, 0.25, 0.1]) ** 2,
        LocalisationStatus.LOCALISED,
    )
    head = replace(
        recording,
        twist_stamps_ns=recording.twist_stamps_ns[:20_000],
        twists=recording.twists[:20_000],
    )
    smoother = LandmarkSmoother(LandmarkConfig())
    online = []
    for step in localise_by_landmarks(head, LandmarkConfig(), start):
        assert step.estimate.status is not LocalisationStatus.LOST
        online.append(step.estimate)
        smoother.add(step)
    errors, nees, wrong = scored(head, online)
    assert math.sqrt(np.mean(np.square(errors))) < 0.12
    assert share_inside(nees, 3) > 0.88
    assert wrong == 0.0
    after = smoothed(head, LandmarkConfig(), start, smoother)
    assert all(each.status is LocalisationStatus.LOCALISED for each in after)
    errors, nees, _ = scored(head, after)
    assert math.sqrt(np.mean(np.square(errors))) < 0.06
    assert share_inside(nees, 3) > 0.85
