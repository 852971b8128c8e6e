"""The watch over the fit: it alarms on a lasting fall, not on scatter, and learns the level."""

import math

import numpy as np
import pytest

from robotctl.estimation.mcl.likelihood_monitor import LikelihoodMonitor

ADVANTAGE = 12.0


def alarms(
    watch: LikelihoodMonitor, evidences: np.ndarray, elsewhere: float = -ADVANTAGE
) -> int | None:
    """Return at which measurement the alarm came; None if never."""
    for i, evidence in enumerate(evidences):
        if watch.is_bad(float(evidence), elsewhere):
            return i
    return None


@pytest.mark.parametrize("level", [0.0, -1.5, 40.0])
@pytest.mark.parametrize("scatter", [0.01, 1.0, 5.0])
def test_scatter_about_a_level_is_no_alarm(level, scatter):
    evidences = level + scatter * np.random.default_rng(1).normal(size=5000)
    assert alarms(LikelihoodMonitor(), evidences, level - ADVANTAGE) is None


@pytest.mark.parametrize("level", [0.0, -4.0, 10.0])
def test_a_lasting_fall_by_four_scatters_is_an_alarm_within_eight_measurements(level):
    rng = np.random.default_rng(2)
    watch = LikelihoodMonitor()
    elsewhere = level - ADVANTAGE
    assert alarms(watch, level + rng.normal(size=1000), elsewhere) is None
    at = alarms(watch, level - 4.0 + rng.normal(size=20), elsewhere)
    assert at is not None
    assert at < 8


@pytest.mark.parametrize(("measurements", "is_alarm"), [(10, False), (30, True)])
def test_what_makes_all_poses_worse_is_an_alarm_only_if_it_lasts(measurements, is_alarm):
    rng = np.random.default_rng(2)
    watch = LikelihoodMonitor()
    assert alarms(watch, rng.normal(size=500)) is None
    crowd = rng.normal(size=measurements) - 6.0
    assert (alarms(watch, crowd, -6.0 - ADVANTAGE) is not None) == is_alarm


def test_a_place_that_resembles_many_others_is_no_alarm():
    rng = np.random.default_rng(2)
    watch = LikelihoodMonitor()
    assert alarms(watch, rng.normal(size=500)) is None
    assert alarms(watch, rng.normal(size=20), -1.0) is None


def test_single_bad_measurements_are_no_alarm():
    evidences = np.random.default_rng(3).normal(size=3000)
    evidences[::20] = -50.0
    assert alarms(LikelihoodMonitor(), evidences) is None


def test_a_fit_that_is_bad_from_the_start_is_an_alarm_before_it_is_learnt():
    assert alarms(LikelihoodMonitor(), np.full(20, -14.0), -10.0) is not None


def test_an_impossible_measurement_counts_like_a_very_bad_one():
    watch, other = LikelihoodMonitor(), LikelihoodMonitor()
    assert alarms(watch, np.full(20, -math.inf)) == alarms(other, np.full(20, -1e3))


def test_forgiven_is_what_has_fallen_and_not_what_is_learnt():
    watch = LikelihoodMonitor()
    rng = np.random.default_rng(4)
    assert alarms(watch, rng.normal(size=300)) is None
    first = alarms(watch, np.full(30, -6.0))
    watch.forgive()
    again = alarms(watch, np.full(30, -6.0))
    assert first is not None
    assert again is not None
    assert first <= again <= first + 2
