"""The pose EKF against laws, closed forms and seeded simulated drives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from robotctl.estimation.kalman.consistency import pose_nees, share_inside
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.kalman.ekf_models import landmark_sighting, wall_range
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, propagate
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap

MS = 1_000_000
LANDMARKS = ((3.0, 0.0), (0.0, 4.0), (-3.0, -1.0), (1.0, -4.0))
ROOM = WallMap(np.array([[-3, -3, 3, -3], [3, -3, 3, 3], [3, 3, -3, 3], [-3, 3, -3, -3]], float))
RING = tuple(
    SonarMount(f"s{degrees}", 0.1, 0.0, float(degrees)) for degrees in (0, 45, 90, 180, -90, -45)
)
SMALL = np.diag([0.01, 0.01, 0.01])


def at(pose=None, covariance=SMALL, stamp_ns=0):
    return PoseEstimate(
        stamp_ns, pose or SE2(), np.asarray(covariance, float), LocalisationStatus.LOCALISED
    )


def drawn(rng, pose, covariance):
    """A pose drawn about another."""
    dx, dy, dtheta = rng.multivariate_normal(np.zeros(3), covariance)
    return SE2(pose.x_m + dx, pose.y_m + dy, pose.theta_rad + dtheta)


def driven(rng, truth, distance, turn, noise, parts=4):
    """Where the robot comes to when the encoders count this much."""
    for _ in range(parts):
        d, a = distance / parts, turn / parts
        along = noise.e_m_per_sqrt_m * math.sqrt(abs(d))
        turning = math.hypot(
            noise.f_rad_per_sqrt_m * math.sqrt(abs(d)), noise.g_rad_per_sqrt_rad * math.sqrt(abs(a))
        )
        truth = arc(truth, d + along * rng.standard_normal(), a + turning * rng.standard_normal())
    return truth


def test_without_measurements_the_covariance_is_that_of_dead_reckoning():
    config = EkfConfig(motion=MotionNoise(0.05, 0.06, 0.07))
    ekf = PoseEkf(config, at())
    pose, covariance = SE2(), SMALL
    for k in range(20):
        ekf.predict((k + 1) * 50 * MS, 0.03, 0.02)
        covariance = propagate(covariance, pose, 0.03, 0.02, config.motion)
        pose = arc(pose, 0.03, 0.02)
    estimate = ekf.estimate()
    np.testing.assert_allclose(estimate.covariance, covariance, rtol=1e-9)
    assert estimate.pose.x_m == pytest.approx(pose.x_m)
    np.testing.assert_allclose(ekf.x[3:], [0.6, 0.4])


def test_a_pose_fix_is_the_product_of_two_gaussians():
    ekf = PoseEkf(EkfConfig(), at())
    fix = np.diag([0.04, 0.01, 0.02])
    ekf.update_pose(0, SE2(0.1, -0.05, 0.02), fix)
    information = np.linalg.inv(SMALL) + np.linalg.inv(fix)
    mean = np.linalg.solve(information, np.linalg.solve(fix, [0.1, -0.05, 0.02]))
    np.testing.assert_allclose(ekf.x[:3], mean, rtol=1e-9)
    np.testing.assert_allclose(ekf.estimate().covariance, np.linalg.inv(information), rtol=1e-9)


def test_headings_on_both_sides_of_pi_are_close():
    ekf = PoseEkf(EkfConfig(), at(SE2(0.0, 0.0, math.pi - 0.01)))
    innovation = ekf.update_pose(0, SE2(0.0, 0.0, -math.pi + 0.01), SMALL)
    assert innovation is not None
    assert innovation.nis == pytest.approx(0.02**2 / 0.02)
    assert abs(ekf.estimate().pose.theta_rad) == pytest.approx(math.pi)


def test_a_landmark_behind_the_robot_has_no_jump_in_its_bearing():
    ekf = PoseEkf(EkfConfig(), at())
    innovation = ekf.update_landmark(0, (-2.0, 0.0), 2.0, -math.pi + 0.001)
    assert innovation is not None
    assert innovation.nis < 0.01


def test_coasting_with_velocity_readings_follows_a_circle():
    ekf = PoseEkf(EkfConfig(), at())
    for k in range(1, 201):
        ekf.coast(k * 10 * MS)
        ekf.update_velocities(k * 10 * MS, 0.5, 0.4, np.diag([1e-4, 1e-4]))
    end = arc(SE2(), 1.0, 0.8)
    pose = ekf.estimate().pose
    assert pose.theta_rad == pytest.approx(end.theta_rad, abs=0.02)
    assert math.hypot(pose.x_m - end.x_m, pose.y_m - end.y_m) < 0.03


def test_a_gyro_corrects_the_heading_that_slipping_wheels_miss_and_its_bias_is_found_at_rest():
    config = EkfConfig(gyro=True, motion=MotionNoise(0.01, 0.01, 0.3), turn_rate_sigma_rad_s=0.002)
    ekf = PoseEkf(config, at())
    for k in range(1, 101):
        ekf.predict(k * 20 * MS, 0.0, 0.0)
        ekf.update_gyro(k * 20 * MS, 0.015)
    assert ekf.x[5] == pytest.approx(0.015, abs=0.001)
    for k in range(101, 151):  # the wheels count 20 % too much
        ekf.predict(k * 20 * MS, 0.0, 0.024)
        ekf.update_gyro(k * 20 * MS, 1.0 + 0.015)
    assert ekf.estimate().pose.theta_rad == pytest.approx(1.0, abs=0.02)


def story(ekf, order, late_ns=0):
    """Drive and see three things; `order` says when each measurement arrives (steps late)."""
    seen = {3: (130 * MS, 1), 5: (220 * MS, 0), 6: (300 * MS, 2)}
    arrivals: dict[int, list[int]] = {}
    for k in seen:
        arrivals.setdefault(k + order.get(k, 0), []).append(k)
    for k in range(1, 13):
        ekf.predict(k * 50 * MS, 0.05, 0.04)
        for each in arrivals.get(k, []):
            stamp_ns, landmark = seen[each]
            pose = arc(SE2(0.02, 0.03, 0.01), stamp_ns / MS / 1000, 0.8 * stamp_ns / MS / 1000)
            z, _ = landmark_sighting(pose, LANDMARKS[landmark])
            ekf.update_landmark(stamp_ns, LANDMARKS[landmark], z[0], z[1])


@pytest.mark.parametrize("order", [{3: 5}, {5: 2, 6: 1}, {3: 6, 5: 1, 6: 4}, {3: -1, 6: -1}])
def test_a_measurement_that_comes_late_or_early_gives_what_it_gives_in_time(order):
    in_time, late = PoseEkf(EkfConfig(), at()), PoseEkf(EkfConfig(), at())
    story(in_time, {})
    story(late, order)
    np.testing.assert_allclose(late.x, in_time.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(late.P, in_time.P, rtol=0, atol=1e-12)
    assert late.too_late == 0


def test_a_measurement_between_two_steps_is_taken_at_its_own_time():
    noise = MotionNoise(0.05, 0.05, 0.05)
    ekf = PoseEkf(EkfConfig(motion=noise), at())
    ekf.predict(100 * MS, 0.1, 0.2)
    by_hand = PoseEkf(EkfConfig(motion=noise), at())
    by_hand.predict(30 * MS, 0.03, 0.06)
    for each in (ekf, by_hand):
        each.update_landmark(30 * MS, LANDMARKS[0], 3.05, 0.02)
    by_hand.predict(100 * MS, 0.07, 0.14)
    np.testing.assert_allclose(ekf.x, by_hand.x, atol=1e-12)
    np.testing.assert_allclose(ekf.P, by_hand.P, atol=1e-12)


def test_a_measurement_older_than_the_history_is_counted_and_left_out():
    ekf = PoseEkf(EkfConfig(history_s=0.2), at())
    for k in range(1, 21):
        ekf.predict(k * 50 * MS, 0.05, 0.0)
    before = ekf.x
    assert ekf.update_pose(500 * MS, SE2(9.0, 9.0, 0.0), SMALL) is None
    assert ekf.too_late == 1
    np.testing.assert_array_equal(ekf.x, before)


def test_a_sonar_that_says_nothing_or_looks_past_all_walls_changes_nothing():
    ekf = PoseEkf(EkfConfig(), at())
    wall = WallMap(np.array([[2.0, -1.0, 2.0, 1.0]]))
    back = SonarMount("back", 0.0, 0.0, 180.0)
    assert ekf.update_sonar(0, back, 1.0, wall) is None
    assert ekf.update_sonar(0, RING[0], math.inf, wall) is None
    assert ekf.update_sonar(0, RING[0], math.nan, wall) is None
    np.testing.assert_array_equal(ekf.P[:3, :3], SMALL)


SONAR = SonarModelConfig(beam_deg=15.0, max_incidence_deg=25.0, sigma_m=0.02, sigma_per_m=0.01)


def simulated(seed, steps=150, outliers=0.0, sonar=False):
    """NEES and NIS of a drive whose noises are those of the configuration."""
    rng = np.random.default_rng(seed)
    config = EkfConfig(motion=MotionNoise(0.03, 0.03, 0.05), sonar=SONAR)
    start = np.diag([0.05, 0.05, 0.05]) ** 2
    truth = drawn(rng, SE2(), start)
    ekf = PoseEkf(config, at(SE2(), start))
    nees, nis = [], []
    for k in range(1, steps + 1):
        now = k * 100 * MS
        turn = 0.1 * math.sin(k / 15.0)
        truth = driven(rng, truth, 0.05, turn, config.motion)
        ekf.predict(now, 0.05, turn)
        if sonar:
            mount = RING[k % len(RING)]
            found = wall_range(truth, mount, ROOM, config.sonar)
            if found is None:
                continue
            sigma = config.sonar.sigma_m + config.sonar.sigma_per_m * found[0]
            z = found[0] + sigma * rng.standard_normal()
            if rng.random() < outliers:
                z = rng.uniform(0.2, 4.0)
            innovation = ekf.update_sonar(now, mount, z, ROOM)
        else:
            landmark = LANDMARKS[k % len(LANDMARKS)]
            expected, _ = landmark_sighting(truth, landmark)
            sigma = 0.05 + 0.02 * expected[0]
            z = expected + [sigma, 0.02] * rng.standard_normal(2)
            if rng.random() < outliers:
                z = np.array([rng.uniform(0.5, 6.0), rng.uniform(-3.0, 3.0)])
            innovation = ekf.update_landmark(now, landmark, z[0], z[1])
        if innovation is not None:
            nis.append(innovation.nis / innovation.dof)
        nees.append(pose_nees(ekf.estimate(), truth))
    return np.array(nees), np.array(nis), ekf, truth


def test_nees_and_nis_keep_their_bounds_over_seeded_drives():
    runs = [simulated(seed) for seed in range(20)]
    last = [nees[-1] for nees, *_ in runs]
    low, high = chi2.ppf([0.005, 0.995], 3 * len(last))
    assert low < sum(last) < high
    nis = np.concatenate([nis for _, nis, *_ in runs])
    low, high = chi2.ppf([0.005, 0.995], 2 * len(nis)) / (2 * len(nis))
    assert low < nis.mean() < high
    inside = share_inside(np.concatenate([nees for nees, *_ in runs]), 3)
    assert inside == pytest.approx(0.95, abs=0.04)


def test_sonar_ranges_alone_hold_the_robot_in_a_room():
    runs = [simulated(seed, sonar=True) for seed in range(10)]
    for nees, _, ekf, truth in runs:
        pose = ekf.estimate().pose
        assert math.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m) < 0.1
        assert np.median(nees) < chi2.ppf(0.95, 3)


@pytest.mark.parametrize("sonar", [False, True])
def test_outliers_neither_drag_the_estimate_away_nor_alarm(sonar):
    for seed in range(8):
        _, _, ekf, truth = simulated(seed, outliers=0.15, sonar=sonar)
        pose = ekf.estimate().pose
        assert math.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m) < 0.25
        assert ekf.estimate().status is LocalisationStatus.LOCALISED


def test_a_robot_carried_away_is_said_to_be_lost_and_pose_fixes_bring_it_back():
    _, _, ekf, truth = simulated(1)
    rng = np.random.default_rng(5)
    stamp_ns = ekf.stamp_ns
    truth = SE2(truth.x_m + 2.0, truth.y_m - 1.5, truth.theta_rad + 2.0)
    said = []
    for k in range(40):
        stamp_ns += 100 * MS
        ekf.predict(stamp_ns, 0.0, 0.0)
        z, _ = landmark_sighting(truth, LANDMARKS[k % 4])
        z = z + [0.05, 0.02] * rng.standard_normal(2)
        ekf.update_landmark(stamp_ns, LANDMARKS[k % 4], z[0], z[1])
        said.append(ekf.estimate().status)
        if LocalisationStatus.LOST in said:
            break
    assert said[-1] is LocalisationStatus.LOST
    assert len(said) <= 20
    for _ in range(60):
        stamp_ns += 100 * MS
        ekf.predict(stamp_ns, 0.0, 0.0)
        ekf.update_pose(stamp_ns, drawn(rng, truth, SMALL / 10), SMALL / 10)
    estimate = ekf.estimate()
    assert estimate.status is LocalisationStatus.LOCALISED
    assert math.hypot(estimate.pose.x_m - truth.x_m, estimate.pose.y_m - truth.y_m) < 0.1


def test_a_filter_too_sure_of_a_wrong_pose_is_not_lost_for_good():
    """A hard gate would refuse these fixes for ever."""
    ekf = PoseEkf(EkfConfig(), at(SE2(), np.eye(3) * 1e-8))
    for k in range(1, 101):
        ekf.predict(k * 100 * MS, 0.0, 0.0)
        ekf.update_pose(k * 100 * MS, SE2(1.0, 1.0, 0.5), SMALL)
    pose = ekf.estimate().pose
    assert (pose.x_m, pose.y_m, pose.theta_rad) == pytest.approx((1.0, 1.0, 0.5), abs=0.05)


def test_long_dead_reckoning_is_no_more_than_a_guess():
    ekf = PoseEkf(EkfConfig(motion=MotionNoise(0.1, 0.1, 0.1)), at())
    for k in range(1, 201):
        ekf.predict(k * 100 * MS, 0.1, 0.0)
    assert ekf.estimate().status is LocalisationStatus.SEARCHING


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda ekf: ekf.predict(-1, 0.1, 0.0), "time goes back"),
        (lambda ekf: ekf.predict(0, 0.1, 0.0), "motion without time"),
        (lambda ekf: ekf.predict(1, math.nan, 0.0), "must be finite"),
        (lambda ekf: ekf.update_gyro(0, 0.1), "gyro: false"),
        (lambda ekf: ekf.update_landmark(0, (1.0, 0.0), math.nan, 0.0), "must be finite"),
        (lambda ekf: ekf.update_pose(0, SE2(), -SMALL), "positive eigenvalues"),
        (lambda ekf: ekf.update_pose(0, SE2(), np.eye(2)), r"\(3, 3\)"),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(act, said):
    ekf = PoseEkf(EkfConfig(), at())
    before = ekf.x
    with pytest.raises(ValueError, match=said):
        act(ekf)
    np.testing.assert_array_equal(ekf.x, before)


def test_settings_out_of_range_name_themselves():
    with pytest.raises(ValueError, match=r"landmark_range_sigma_m: 0.0 found"):
        EkfConfig(landmark_range_sigma_m=0.0)
    with pytest.raises(ValueError, match=r"history_s: -1.0 found"):
        EkfConfig(history_s=-1.0)
