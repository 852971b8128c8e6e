"""The score of a localiser on hand-made runs."""

import math

import pytest
from scipy.stats import chi2

from robotctl.app.scoring.localisation_score import LocalisationScore
from robotctl.app.scoring.score import StampedPose
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus

PERIOD_NS = 100_000_000
SEARCHING, LOCALISED = LocalisationStatus.SEARCHING, LocalisationStatus.LOCALISED


def state(stamp_ns, status=LOCALISED, covariance=(0.01, 0.0, 0.0, 0.01, 0.0, 0.01), **more):
    return LocalisationState(stamp_ns, "mcl", status, 0.0, 0.0, 0.0, covariance, **more)


def scored(*steps, odometry_m=0.0):
    """Score a robot that stands at the origin; steps are (estimated x, status, ...)."""
    score = LocalisationScore()
    for number, (x_m, status, *more) in enumerate(steps):
        stamp_ns = number * PERIOD_NS
        score.truth(StampedPose(stamp_ns, 0.0, 0.0, 0.0))
        score.estimate(
            StampedPose(stamp_ns, x_m, 0.0, more[0] if more else 0.0),
            state(stamp_ns, status),
            StampedPose(stamp_ns, odometry_m, 0.0, 0.0),
        )
    return score.result()


def test_without_estimates_there_is_no_report():
    assert LocalisationScore().result() is None


def test_time_to_localise_ends_when_it_says_so_and_is_right():
    result = scored((3.0, SEARCHING), (0.1, SEARCHING), (2.0, LOCALISED), (0.1, LOCALISED))
    assert result.localised_after_s == pytest.approx(0.3)


def test_a_heading_that_is_far_off_is_not_right():
    result = scored((0.0, LOCALISED, 3.0), (0.0, LOCALISED, 0.1))
    assert result.localised_after_s == pytest.approx(0.1)


def test_claims_that_are_wrong_are_counted_in_time():
    result = scored((0.0, LOCALISED), (2.0, LOCALISED), (2.0, SEARCHING), (2.0, LOCALISED))
    assert result.wrong_s == pytest.approx(0.2)


def test_errors_count_while_it_says_that_it_is_localised_and_has_been_right():
    result = scored((9.0, LOCALISED), (0.3, LOCALISED), (7.0, SEARCHING), (0.4, LOCALISED))
    assert result.error.rmse_m == pytest.approx(math.sqrt((0.09 + 0.16) / 2))
    assert result.error.max_m == pytest.approx(0.4)
    assert result.localised_share == pytest.approx(0.5)


def test_one_that_is_never_right_has_no_time_and_no_error():
    result = scored((9.0, LOCALISED), (9.0, LOCALISED))
    assert (result.localised_after_s, result.error.max_m, result.nees_inside_95) == (
        None,
        0.0,
        None,
    )


def test_the_odometry_alone_is_scored_beside_it():
    assert scored((0.0, LOCALISED), (0.0, LOCALISED), odometry_m=0.7).odometry_rmse_m == 0.7


def test_nees_is_inside_when_the_covariance_fits():
    # With sigma 0.1 in all three, an error of d metres along x has NEES (d / 0.1)^2.
    low, high = chi2.ppf((0.025, 0.975), 3)
    fits, small, large = 0.1 * math.sqrt(1.01 * low), 0.05 * math.sqrt(low), 0.101 * math.sqrt(high)
    result = scored((fits, LOCALISED), (small, LOCALISED), (large, LOCALISED), (fits, LOCALISED))
    assert (result.nees_inside_95, result.nees_above_95) == (0.5, 0.25)


def test_a_covariance_of_zero_fits_nothing():
    score = LocalisationScore()
    pose = StampedPose(0, 0.0, 0.0, 0.0)
    score.truth(pose)
    score.estimate(pose, state(0, covariance=(0.0,) * 6), pose)
    assert (score.result().nees_inside_95, score.result().nees_above_95) == (0.0, 1.0)


def test_nis_is_measured_by_its_own_degrees_of_freedom():
    score = LocalisationScore()
    for number, (nis, dof) in enumerate([(1.0, 1), (6.0, 1), (6.0, 3), (float("nan"), 0)]):
        pose = StampedPose(number, 0.0, 0.0, 0.0)
        score.truth(pose)
        score.estimate(pose, state(number, nis=nis, nis_dof=dof), pose)
    assert score.result().nis_inside_95 == pytest.approx(2 / 3)
