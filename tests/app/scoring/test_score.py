"""The score on hand-made runs."""

import math

import pytest

from robotctl.app.scoring.score import PoseScore, StampedPose


def test_an_estimate_is_compared_with_the_truth_of_its_own_time() -> None:
    score = PoseScore()
    score.truth(StampedPose(0, 0.0, 0.0, 0.0))
    score.estimate(StampedPose(5, 0.5, 0.3, 0.0))
    assert score.result().max_m == 0.0
    score.truth(StampedPose(10, 1.0, 0.0, 0.0))
    result = score.result()
    assert result.rmse_m == pytest.approx(0.3)
    assert result.final_m == pytest.approx(0.3)


def test_headings_are_interpolated_and_compared_on_the_circle() -> None:
    score = PoseScore()
    score.truth(StampedPose(0, 0.0, 0.0, math.pi - 0.1))
    score.truth(StampedPose(10, 0.0, 0.0, -math.pi + 0.1))
    score.estimate(StampedPose(5, 0.0, 0.0, -math.pi + 0.05))
    assert score.result().final_rad == pytest.approx(0.05)


def test_rmse_max_and_final_differ() -> None:
    score = PoseScore()
    for stamp, error in ((0, 0.0), (10, 0.4), (20, 0.3)):
        score.truth(StampedPose(stamp, 1.0, 1.0, 0.0))
        score.estimate(StampedPose(stamp, 1.0 + error, 1.0, 0.0))
    result = score.result()
    assert result.rmse_m == pytest.approx(math.sqrt(0.25 / 3))
    assert (result.max_m, result.final_m) == pytest.approx((0.4, 0.3))


def test_an_estimate_before_the_first_truth_is_left_out() -> None:
    score = PoseScore()
    score.estimate(StampedPose(0, 9.0, 9.0, 0.0))
    score.truth(StampedPose(10, 0.0, 0.0, 0.0))
    score.estimate(StampedPose(10, 0.1, 0.0, 0.0))
    assert score.result().max_m == pytest.approx(0.1)


def test_an_estimate_that_comes_half_a_minute_late_still_has_its_truth() -> None:
    score = PoseScore()
    for second in range(200):
        score.truth(StampedPose(second * 10**9, float(second), 0.0, 0.0))
    score.estimate(StampedPose(170 * 10**9, 170.25, 0.0, 0.0))
    assert score.result().final_m == pytest.approx(0.25)
