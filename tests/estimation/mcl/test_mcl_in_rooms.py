"""Monte Carlo localisation on a public lidar log and in a simulated flat: short runs, one seed.

`python -m benchmarks mcl mcl-sonar` runs many seeds in full: docs/results/localisation.md.
"""

import numpy as np
import pytest

from benchmarks import localisation_accuracy, localisation_sonar

INTEL = "carmen/intel-odometry.log.gz"


@pytest.fixture(scope="module")
def intel(recordings):
    return localisation_accuracy.load("Intel", recordings)


@pytest.fixture(scope="module")
def museum(recordings):
    return localisation_accuracy.load("museum", recordings)


@pytest.mark.recordings(INTEL)
def test_a_tracked_robot_keeps_its_place_on_raw_odometry(intel):
    errors = localisation_accuracy.track(intel, seed=1)
    assert errors.right.all()
    assert np.sqrt(np.mean(errors.off_m**2)) <= 0.075
    assert np.degrees(np.sqrt(np.mean(errors.off_rad**2))) <= 0.9


@pytest.mark.recordings(INTEL)
def test_a_robot_that_starts_anywhere_is_found_in_the_first_scans(intel):
    errors = localisation_accuracy.find(intel, seed=1, anywhere=False)
    assert errors.right[-30:].all()
    assert errors.sure[-30:].all()


@pytest.mark.recordings(INTEL)
def test_a_robot_that_is_carried_away_is_found_again(intel):
    before, after = localisation_accuracy.carry(intel, seed=1)
    assert before.right.all()
    assert after.right[-30:].all()
    assert after.sure[-30:].all()


@pytest.mark.recordings("carmen/fhw-odometry.log.gz")
@pytest.mark.parametrize("seed", range(3))
def test_visitors_around_the_robot_do_not_make_it_lose_its_place(museum, seed):
    """They hide 50 to 90 % of the beams for stretches of the way."""
    errors = localisation_accuracy.track(museum, seed)
    assert errors.sure.all()
    assert errors.off_m.max() < 0.5
    assert np.sqrt(np.mean(errors.off_m**2)) <= 0.08


def test_eight_sonars_find_a_robot_in_the_flat_and_find_it_again(monkeypatch):
    monkeypatch.setattr(localisation_sonar, "SECONDS", 12.0)
    room = localisation_sonar.Room.load("flat")
    outcomes = list(localisation_sonar.searches(room, seed=2))
    assert outcomes
    assert all(outcome.right for outcome in outcomes)
