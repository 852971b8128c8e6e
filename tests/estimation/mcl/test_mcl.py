"""Monte Carlo localisation: closed forms, reproducibility, searches, and a robot carried away."""

import math

import numpy as np
import pytest

from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.mcl.particle_motion import ParticleMotionConfig
from robotctl.model.drives.motion_noise import MotionNoise, propagate
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap

ROOM = free_poses(GridMap(np.zeros((100, 200), np.int8), 0.1))
BEACONS = np.array([[1.0, 1.0], [18.0, 2.0], [4.0, 9.0], [12.0, 8.0]])
STEP = SE2(0.3, 0.0, 0.05)


def beacons_from(pose: SE2, sigma_m: float = 0.1, sigma_rad: float = 0.05):
    """Ranges and bearings to four beacons, without noise."""
    seen = np.array([pose.inverse().apply(x, y) for x, y in BEACONS])

    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        dx = BEACONS[:, 0] - poses[:, :1]
        dy = BEACONS[:, 1] - poses[:, 1:2]
        ranges = np.hypot(dx, dy) - np.hypot(seen[:, 0], seen[:, 1])
        bearings = np.arctan2(dy, dx) - poses[:, 2:] - np.arctan2(seen[:, 1], seen[:, 0])
        bearings -= math.tau * np.round(bearings / math.tau)
        return -0.5 * np.sum((ranges / sigma_m) ** 2 + (bearings / sigma_rad) ** 2, axis=1)

    return log_likelihood


def localiser(seed: int = 1, **settings) -> MonteCarloLocaliser:
    return MonteCarloLocaliser(MclConfig(**settings), ROOM, np.random.default_rng(seed))


def drive(mcl: MonteCarloLocaliser, pose: SE2, steps: int) -> SE2:
    """Drive on from `pose` and measure after each step."""
    for _ in range(steps):
        pose = pose @ STEP
        mcl.move(STEP)
        mcl.measure(beacons_from(pose))
    return pose


def off_m(mcl: MonteCarloLocaliser, pose: SE2) -> float:
    estimate = mcl.estimate(0).pose
    return math.hypot(estimate.x_m - pose.x_m, estimate.y_m - pose.y_m)


def test_a_gaussian_belief_and_measurement_give_the_posterior_of_the_kalman_filter():
    """Prior N(10, 0.5^2) moved by odometry, measured at 10.9 with sigma 0.4; 50000 particles."""
    floor = 0.2
    motion = ParticleMotionConfig(MotionNoise(0.0, 0.0, 0.0), floor, 1e-6)
    mcl = localiser(min_particles=50_000, max_particles=50_000, motion=motion)
    mcl.start_at(SE2(10.0, 5.0, 0.0), 0.5, 0.0)
    mcl.move(SE2(0.6, 0.0, 0.0))
    mcl.measure(lambda poses: -0.5 * ((poses[:, 0] - 10.9) / 0.4) ** 2)
    prior = 0.5**2 + floor**2
    gain = prior / (prior + 0.4**2)
    x, y = mcl.weights @ mcl.poses[:, :2]
    variance = mcl.weights @ (mcl.poses[:, 0] - x) ** 2
    assert x == pytest.approx(10.6 + gain * 0.3, abs=0.01)
    assert variance == pytest.approx((1.0 - gain) * prior, rel=0.03)
    assert y == pytest.approx(5.0, abs=0.01)


def test_the_same_seed_gives_the_same_bits_and_another_one_does_not():
    def run(seed: int) -> tuple[bytes, bytes, bytes]:
        mcl = localiser(seed, max_particles=3000)
        drive(mcl, SE2(3.0, 3.0, 0.3), 12)
        estimate = mcl.estimate(0)
        pose = np.array([estimate.pose.x_m, estimate.pose.y_m, estimate.pose.theta_rad])
        return mcl.poses.tobytes(), mcl.weights.tobytes(), pose.tobytes()

    assert run(7) == run(7)
    assert run(7) != run(8)


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_that_starts_anywhere_is_found_and_then_needs_few_particles(seed):
    mcl = localiser(seed, min_particles=300, max_particles=5000)
    assert len(mcl.poses) == 5000
    pose = drive(mcl, SE2(3.0, 3.0, 0.3), 12)
    assert off_m(mcl, pose) < 0.1
    assert mcl.status is LocalisationStatus.LOCALISED
    assert len(mcl.poses) == 300


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_that_is_carried_away_is_missed_and_found_again(seed):
    mcl = localiser(seed, min_particles=300, max_particles=5000)
    mcl.start_at(SE2(3.0, 3.0, 0.3), 0.1, 0.05)
    drive(mcl, SE2(3.0, 3.0, 0.3), 8)
    assert mcl.status is LocalisationStatus.LOCALISED
    pose = drive(mcl, SE2(15.0, 6.0, -2.0), 1)
    assert mcl.status is LocalisationStatus.LOST
    pose = drive(mcl, pose, 8)
    assert mcl.status is LocalisationStatus.LOCALISED
    assert off_m(mcl, pose) < 0.1


def test_a_wrong_start_is_noticed():
    mcl = localiser(max_particles=5000)
    mcl.start_at(SE2(15.0, 8.0, 0.0), 0.2, 0.1)
    pose = drive(mcl, SE2(3.0, 3.0, 0.3), 8)
    assert off_m(mcl, pose) < 0.1


def test_the_place_is_kept_until_another_one_has_proven_itself_on_the_way():
    """A robot that is carried away: the estimate goes on by odometry, then it is the right one."""
    mcl = localiser(max_particles=5000)
    mcl.start_at(SE2(3.0, 3.0, 0.3), 0.1, 0.05)
    old = drive(mcl, SE2(3.0, 3.0, 0.3), 8)
    pose, driven_m = SE2(15.0, 6.0, -2.0), 0.0
    while off_m(mcl, pose) > 0.2:
        assert off_m(mcl, old) < 3.0
        assert driven_m == 0.0 or mcl.status is not LocalisationStatus.LOCALISED
        old, pose, driven_m = old @ STEP, drive(mcl, pose, 1), driven_m + 0.3
        assert driven_m < 3.0
    assert driven_m > 0.5


def test_what_is_forgiven_is_no_reason_to_look_elsewhere():
    """Measurements that fit nowhere, but that the tracked place is forgiven for: a crowd."""

    class Crowd:
        def __init__(self, pose: SE2) -> None:
            self.right = beacons_from(pose)

        def __call__(self, poses: np.ndarray) -> np.ndarray:
            return np.maximum(self.right(poses), -5.0) - 20.0

        def forgiven(self, poses: np.ndarray) -> np.ndarray:
            return np.maximum(self.right(poses), -20.0)

    mcl = localiser(max_particles=2000)
    pose = SE2(3.0, 3.0, 0.3)
    mcl.start_at(pose, 0.05, 0.05)
    pose = drive(mcl, pose, 8)
    for _ in range(40):
        pose = pose @ STEP
        mcl.move(STEP)
        mcl.measure(Crowd(pose))
        assert mcl.status is LocalisationStatus.LOCALISED
        assert off_m(mcl, pose) < 0.3


def walls_of_a_corridor(pose: SE2):
    """Distance to its walls and the angle to them: nothing tells how far along it is."""

    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        off_m, off_rad = poses[:, 1] - pose.y_m, poses[:, 2] - pose.theta_rad
        return -0.5 * ((off_m / 0.05) ** 2 + (off_rad / 0.05) ** 2)

    return log_likelihood


def along_a_corridor(mcl: MonteCarloLocaliser, pose: SE2, steps: int):
    """Yield the standard deviation along it [m], and what is said, after each step."""
    ahead = SE2(0.1, 0.0, 0.0)
    for _ in range(steps):
        pose = pose @ ahead
        mcl.move(ahead)
        mcl.measure(walls_of_a_corridor(pose), "sonar")
        yield math.sqrt(mcl.estimate(0).covariance[0, 0]), mcl.status, mcl.is_tracked


def test_along_a_corridor_a_robot_is_tracked_while_its_place_gets_less_sure():
    noise = ParticleMotionConfig(MotionNoise(0.3, 0.1, 0.1))
    mcl = localiser(motion=noise, tracked_m=0.6)
    mcl.start_at(SE2(1.0, 5.0, 0.0), 0.05, 0.02)
    seen = set()
    for sigma_m, status, is_tracked in along_a_corridor(mcl, SE2(1.0, 5.0, 0.0), 80):
        assert is_tracked == (sigma_m <= 0.6)
        if sigma_m > 0.31:
            assert status is LocalisationStatus.SEARCHING
        seen.add((status is LocalisationStatus.LOCALISED, is_tracked))
    assert seen == {(True, True), (False, True), (False, False)}


def test_a_place_that_never_was_sure_is_not_tracked():
    mcl = localiser()
    mcl.start_at(SE2(1.0, 5.0, 0.0), 0.4, 0.02)
    assert not any(tracked for *_, tracked in along_a_corridor(mcl, SE2(1.0, 5.0, 0.0), 20))


def test_a_robot_that_was_carried_away_is_not_tracked_until_it_is_localised_again():
    mcl = localiser(max_particles=5000)
    mcl.start_at(SE2(3.0, 3.0, 0.3), 0.05, 0.05)
    drive(mcl, SE2(3.0, 3.0, 0.3), 8)
    assert mcl.is_tracked
    pose = SE2(15.0, 6.0, 2.0)
    for _ in range(40):
        pose = drive(mcl, pose, 1)
        if off_m(mcl, pose) > 1.0 and mcl.status is not LocalisationStatus.LOCALISED:
            assert not mcl.is_tracked
    assert mcl.status is LocalisationStatus.LOCALISED
    assert mcl.is_tracked
    assert off_m(mcl, pose) < 0.3


def one_beacon(pose: SE2):
    """Range to one beacon: a sensor that says little."""
    seen_m = math.hypot(*(BEACONS[0] - (pose.x_m, pose.y_m)))

    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        off_m = np.hypot(*(BEACONS[0] - poses[:, :2]).T) - seen_m
        return np.maximum(-0.5 * (off_m / 0.3) ** 2, -8.0)

    return log_likelihood


@pytest.mark.parametrize("sees_all", [True, False])
def test_one_sensor_that_is_hidden_is_no_doubt_while_one_that_says_more_fits(sees_all):
    mcl = localiser(min_particles=500, max_particles=5000)
    pose = SE2(9.0, 3.0, 0.0)
    mcl.start_at(pose, 0.05, 0.02)
    statuses = set()
    for step in range(30):
        pose = pose @ STEP
        mcl.move(STEP)
        is_hidden = step >= 20
        if sees_all or not is_hidden:
            mcl.measure(beacons_from(pose), "scan")
        mcl.measure(one_beacon(SE2(2.0, 2.0, 0.0) if is_hidden else pose), "cone")
        statuses.add(mcl.status)
    assert (LocalisationStatus.LOST in statuses) is not sees_all


def test_a_robot_that_was_carried_away_is_missed_by_both_sensors():
    mcl = localiser(min_particles=500, max_particles=5000)
    mcl.start_at(SE2(3.0, 3.0, 0.3), 0.05, 0.02)
    for begin, steps in ((SE2(3.0, 3.0, 0.3), 12), (SE2(15.0, 6.0, -2.0), 3)):
        for step in range(1, steps + 1):
            pose = begin @ SE2.exp(*(step * np.array([0.3, 0.0, 0.05])).tolist())
            mcl.move(STEP)
            mcl.measure(one_beacon(pose), "cone")
            mcl.measure(beacons_from(pose), "scan")
    assert mcl.status is not LocalisationStatus.LOCALISED


def test_a_search_in_slices_ends_as_one_at_once_and_the_robot_may_drive_meanwhile():
    at_once, sliced = localiser(), localiser()
    pose = SE2(5.0, 5.0, 1.0)
    for _ in range(8):
        at_once.measure(beacons_from(pose))
        work = sliced.measuring(beacons_from(pose))
        weighed = [next(work)]
        sliced.move(STEP)
        weighed += work
        at_once.move(STEP)
        np.testing.assert_array_equal(sliced.poses, at_once.poses)
        assert sliced.estimate(0).pose == at_once.estimate(0).pose
        assert sliced.status is at_once.status
        assert max(weighed) <= 5000
        pose = pose @ STEP
    assert at_once.status is LocalisationStatus.LOCALISED
    assert off_m(sliced, pose) < 0.1


def test_between_measurements_the_estimate_moves_on_with_growing_covariance():
    mcl = localiser()
    mcl.start_at(SE2(5.0, 5.0, 1.0), 0.1, 0.05)
    before = mcl.estimate(0)
    mcl.move(SE2(0.05, 0.0, 0.0))
    mcl.move(SE2(0.03, 0.0, 0.0))
    after = mcl.estimate(7)
    assert after.stamp_ns == 7
    expected = before.pose @ SE2(0.08, 0.0, 0.0)
    assert (after.pose.x_m, after.pose.y_m) == pytest.approx((expected.x_m, expected.y_m))
    grown = propagate(before.covariance, before.pose, 0.08, 0.0, MclConfig().motion.noise)
    np.testing.assert_allclose(after.covariance, grown, atol=1e-12)


def test_a_measurement_is_due_at_first_and_then_after_enough_motion():
    mcl = localiser(max_particles=1000, update_min_m=0.2, update_min_rad=0.3)
    pose = SE2(3.0, 3.0, 0.0)
    assert mcl.due()
    mcl.measure(beacons_from(pose))
    assert not mcl.due()
    mcl.move(SE2(0.15, 0.0, 0.0))
    assert not mcl.due()
    mcl.move(SE2(-0.1, 0.0, 0.0))
    assert mcl.due()
    mcl.measure(beacons_from(pose))
    mcl.move(SE2(0.0, 0.0, -0.35))
    assert mcl.due()


def test_two_sensors_at_one_instant_weigh_the_belief_as_their_product():
    settings = {"min_particles": 2000, "max_particles": 2000, "uniform_probes": 1e-3}
    one, two = localiser(3, **settings), localiser(3, **settings)
    pose = SE2(10.0, 5.0, 0.5)
    for mcl in (one, two):
        mcl.start_at(pose, 0.05, 0.02)
    once, again = beacons_from(pose, 0.5, 0.5), beacons_from(pose, 0.4, 0.4)
    one.measure(lambda poses: once(poses) + again(poses))
    two.measure(once)
    two.measure(again)
    a, b = one.estimate(0), two.estimate(0)
    assert (a.pose.x_m, a.pose.y_m) == pytest.approx((b.pose.x_m, b.pose.y_m), abs=0.01)
    np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-3)


def test_a_measurement_that_fits_nowhere_is_not_taken_in():
    mcl = localiser(max_particles=1000)
    mcl.start_at(SE2(5.0, 5.0, 0.0), 0.1, 0.05)
    mcl.measure(lambda poses: np.full(len(poses), -math.inf))
    assert mcl.status is LocalisationStatus.LOST
    assert off_m(mcl, SE2(5.0, 5.0, 0.0)) < 0.05


def test_two_places_that_look_alike_are_two_clusters_and_no_localisation():
    """Ranges to beacons on a line cannot tell the two sides of it."""
    ranges = np.hypot(np.array([4.0, 10.0, 16.0]) - 7.0, 2.0)

    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        x = np.array([4.0, 10.0, 16.0]) - poses[:, :1]
        off = np.hypot(x, 5.0 - poses[:, 1:2]) - ranges
        return -0.5 * np.sum((off / 0.1) ** 2, axis=1) - 0.5 * (poses[:, 2] / 0.1) ** 2

    mcl = localiser(max_particles=5000, localised_updates=1)
    mcl.measure(log_likelihood)
    assert len(mcl.clusters) == 2
    assert sorted(round(cluster.mean.y_m) for cluster in mcl.clusters) == [3, 7]
    assert mcl.status is LocalisationStatus.SEARCHING


def beacons_of_a_symmetric_room(pose: SE2):
    """Seen alike from the same place turned by 180 degrees about the middle, (10, 5)."""
    here, there = (
        beacons_from(pose),
        beacons_from(SE2(10.0, 5.0, math.pi) @ SE2(-10.0, -5.0) @ pose),
    )
    return lambda poses: np.logaddexp(here(poses), there(poses))


@pytest.mark.parametrize("seed", range(5))
def test_a_room_that_looks_the_same_from_both_ends_is_no_place_that_is_known(seed):
    mcl = localiser(seed, min_particles=300, max_particles=5000)
    pose = SE2(4.0, 3.0, 0.3)
    for _ in range(20):
        pose = pose @ STEP
        mcl.move(STEP)
        mcl.measure(beacons_of_a_symmetric_room(pose))
        assert mcl.status is not LocalisationStatus.LOCALISED


@pytest.mark.parametrize("seed", range(5))
def test_what_tells_two_ends_of_a_room_apart_at_last_decides(seed):
    mcl = localiser(seed, min_particles=300, max_particles=5000)
    pose = SE2(4.0, 3.0, 0.3)
    for i in range(24):
        pose = pose @ STEP
        mcl.move(STEP)
        mcl.measure((beacons_of_a_symmetric_room if i < 10 else beacons_from)(pose))
        if mcl.status is LocalisationStatus.LOCALISED:
            assert off_m(mcl, pose) < 0.2
    assert mcl.status is LocalisationStatus.LOCALISED


def test_what_fits_no_place_of_the_map_is_lost_and_not_localised():
    """A sensor that can forgive, and yet sees walls where the map has none, from everywhere."""

    class Elsewhere:
        def __init__(self, pose: SE2) -> None:
            self.right = beacons_from(pose)

        def __call__(self, poses: np.ndarray) -> np.ndarray:
            return np.maximum(self.right(poses), -5.0) - 15.0

        forgiven = __call__

    mcl = localiser(max_particles=5000)
    pose, statuses = SE2(3.0, 3.0, 0.3), []
    for _ in range(25):
        pose = pose @ STEP
        mcl.move(STEP)
        mcl.measure(Elsewhere(pose))
        statuses.append(mcl.status)
    assert LocalisationStatus.LOCALISED not in statuses[10:]
    assert set(statuses[12:]) == {LocalisationStatus.LOST}
    assert mcl.fits_nowhere


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"min_particles": 0}, "min_particles"),
        ({"min_particles": 30, "max_particles": 20}, "max_particles"),
        ({"max_particles": 3000, "search_poses": 2000}, "search_poses"),
        ({"resample_below": 0.0}, "resample_below"),
        ({"n_eff_floor": 1.0}, "n_eff_floor"),
        ({"carried_away": 0.5}, "carried_away"),
        ({"kld_error": math.inf}, "kld_error"),
        ({"update_min_m": -0.1}, "update_min_m"),
        ({"localised_updates": 0}, "localised_updates"),
    ],
)
def test_settings_out_of_range_are_refused(settings, named):
    with pytest.raises(ValueError, match=named):
        MclConfig(**settings)


@pytest.mark.parametrize(("sigma_m", "sigma_rad"), [(-0.1, 0.1), (0.1, math.nan), (math.inf, 0.1)])
def test_an_uncertainty_out_of_range_is_refused(sigma_m, sigma_rad):
    with pytest.raises(ValueError, match="sigma_m"):
        localiser(max_particles=1000).start_at(SE2(), sigma_m, sigma_rad)


def test_a_likelihood_of_the_wrong_shape_is_refused():
    mcl = localiser(max_particles=1000)
    mcl.start_at(SE2(5.0, 5.0, 0.0), 0.1, 0.05)
    with pytest.raises(ValueError, match=r"log-likelihoods must be \(1000,\)"):
        mcl.measure(lambda poses: np.zeros((len(poses), 1)))


def test_a_robot_that_drives_on_without_measurements_is_localised_no_more_at_last():
    mcl = localiser()
    mcl.start_at(SE2(), 0.05, 0.02)
    sigmas = []
    while mcl.estimate(0).status is LocalisationStatus.LOCALISED:
        mcl.move(SE2(0.1, 0.0, 0.0))
        sigmas.append(math.sqrt(np.linalg.eigvalsh(mcl.estimate(0).covariance[:2, :2])[-1]))
        assert len(sigmas) < 10_000
    assert np.all(np.diff(sigmas) > 0.0)
    assert sigmas[-2] <= MclConfig().localised_m < sigmas[-1]
