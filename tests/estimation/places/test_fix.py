"""A recognised place as a measurement: its density by scipy, and what particles make of it."""

import math

import numpy as np
import pytest
from scipy import stats

from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.fix import PlaceFixConfig, place_fix
from robotctl.estimation.places.places import SonarCandidate, SonarRecognition
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap
from tests.estimation.places.room_echoes import L_ROOM, heard

AREA_M2 = 40.0
COVARIANCE = np.array([[0.01, 0.004, 0.001], [0.004, 0.02, 0.0], [0.001, 0.0, 0.005]])


def candidate(x, y, theta, weight=1.0, *, in_world=True, covariance=COVARIANCE):
    return SonarCandidate(
        "a", SE2(x, y, theta), weight, difference=0.02, in_world=in_world, rotation_rad=0.0,
        covariance=covariance,
    )  # fmt: skip


def recognition(*candidates, refusal=""):
    return SonarRecognition(tuple(candidates), refusal, threshold=0.1)


def test_the_density_is_the_mixture_of_its_candidates_and_of_anywhere():
    placed = [candidate(1.0, 2.0, 3.1, 0.7), candidate(4.0, 1.0, -1.0, 0.3)]
    config = PlaceFixConfig(wrong=0.1, widen=1.5)
    rng = np.random.default_rng(1)
    poses = np.concatenate(
        [
            rng.uniform((0, 0, -math.pi), (6, 5, math.pi), (50, 3)),
            np.array([(1.0, 2.0, 3.1), (1.1, 2.1, -3.1), (4.0, 1.0, -1.0)]),
        ]
    )
    found = place_fix(recognition(*placed), AREA_M2, config)(poses)
    expected = np.full(len(poses), 0.1 / (2 * math.pi * AREA_M2))
    for each in placed:
        off = poses - (each.pose.x_m, each.pose.y_m, each.pose.theta_rad)
        off[:, 2] = np.angle(np.exp(1j * off[:, 2]))
        normal = stats.multivariate_normal(np.zeros(3), 1.5**2 * COVARIANCE)
        expected += 0.9 * each.score * normal.pdf(off)
    assert np.allclose(found - found[-1], np.log(expected) - np.log(expected[-1]))


def test_the_best_pose_has_about_0_and_far_away_all_are_alike():
    fix = place_fix(recognition(candidate(1.0, 2.0, 0.5)), AREA_M2)
    best, *far = fix(np.array([(1.0, 2.0, 0.5), (5.0, 4.0, 0.5), (1.0, 2.0, -2.5)]))
    assert best == pytest.approx(0.0, abs=1e-9)
    assert far[0] == pytest.approx(far[1])
    assert far[0] < -4.0


def test_it_does_not_change_the_poses_that_it_weighs():
    poses = np.array([(1.0, 2.0, 9.0)])
    place_fix(recognition(candidate(1.0, 2.0, 0.5)), AREA_M2)(poses)
    assert poses[0, 2] == 9.0


def test_places_of_which_nobody_knows_where_they_are_say_nothing_of_poses():
    lost = candidate(0.0, 0.0, 1.0, in_world=False)
    assert place_fix(recognition(lost), AREA_M2) is None
    assert place_fix(SonarRecognition((), "unknown", threshold=0.1), AREA_M2) is None
    there = candidate(3.0, 1.0, 0.0, 0.5)
    both = place_fix(recognition(lost, there), AREA_M2)
    alone = place_fix(recognition(there), AREA_M2)
    poses = np.array([(3.0, 1.0, 0.1), (0.0, 0.0, 1.0)])
    assert np.allclose(both(poses), alone(poses))


@pytest.mark.parametrize(
    "make",
    [
        lambda: PlaceFixConfig(wrong=0.0),
        lambda: PlaceFixConfig(widen=0.5),
        lambda: place_fix(recognition(), 0.0),
    ],
)
def test_values_out_of_range_are_refused(make):
    with pytest.raises(ValueError, match="must be"):
        make()


@pytest.fixture(scope="module")
def room():
    """Sampler of the room of the echoes, and a book of three places in it."""
    book = PlaceBook()
    for name, pose in (
        ("west", SE2(1.0, 1.5, 0.3)), ("east", SE2(5.0, 2.3, -2.0)), ("north", SE2(2.3, 4.3, 1.5))
    ):  # fmt: skip
        book = book.learned(name, heard(L_ROOM, pose.x_m, pose.y_m, pose.theta_rad), pose)
    return free_poses(grid_of_walls(WallMap(np.array(L_ROOM, float)))), book


def localiser(room, seed=1):
    return MonteCarloLocaliser(MclConfig(max_particles=5000), room[0], np.random.default_rng(seed))


def share_near(mcl, x, y, theta):
    off = mcl.poses - (x, y, theta)
    turned = np.abs(np.angle(np.exp(1j * off[:, 2])))
    return float(mcl.weights[(np.hypot(off[:, 0], off[:, 1]) < 0.5) & (turned < 0.5)].sum())


@pytest.mark.parametrize("seed", range(4))
def test_one_recognition_pulls_a_cloud_that_is_anywhere_to_the_place(room, seed):
    mcl = localiser(room, seed)
    true = (5.03, 2.27, 0.8)
    assert share_near(mcl, *true) < 0.02
    mcl.measure(place_fix(room[1].suggest(heard(L_ROOM, *true)), 20.0), "places")
    assert share_near(mcl, *true) > 0.8
    estimate = mcl.estimate(0)
    assert math.hypot(estimate.pose.x_m - true[0], estimate.pose.y_m - true[1]) < 0.3


def test_two_places_alike_keep_both_in_the_cloud(room):
    both = recognition(candidate(1, 1.5, 0, 0.5), candidate(5, 2.3, 2, 0.5), refusal="ambiguous")
    mcl = localiser(room)
    mcl.measure(place_fix(both, 20.0), "places")
    shares = share_near(mcl, 1, 1.5, 0), share_near(mcl, 5, 2.3, 2)
    assert min(shares) > 0.2
    assert sum(shares) > 0.65


def test_one_wrong_recognition_does_not_carry_a_localised_robot_away(room):
    mcl = localiser(room)
    mcl.start_at(SE2(1.0, 1.5, 0.3), 0.1, 0.05)
    mcl.measure(place_fix(recognition(candidate(5.0, 2.3, 0.0)), 20.0), "places")
    assert mcl.status is LocalisationStatus.LOCALISED
    assert share_near(mcl, 1.0, 1.5, 0.3) > 0.95
