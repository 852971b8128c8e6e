"""The place recogniser of docs/extending.md suggests the place that looks alike, and only that."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.candidates import PossiblePlaces
from robotctl.estimation.slam.keyframes.recognisers import SCAN_RECOGNISERS
from robotctl.estimation.slam_tuning import SlamTuning
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2


def ring(radius_m):
    angles = np.linspace(0.0, 2.0 * np.pi, 100)
    return radius_m * np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize(("radius_m", "places"), [(2.1, [1]), (5.1, [])])
def test_a_place_where_things_are_as_far_away_is_suggested(radius_m, places):
    recogniser = SCAN_RECOGNISERS["distances"](SlamTuning())
    for each in (1.1, 2.1, 3.1):
        recogniser.add([(SE2(), ring(each))])
    recogniser.add([(SE2(), moved(SE2(0.0, 0.0, 1.0), ring(radius_m)))])
    assert len(recogniser) == 4
    among = PossiblePlaces(3, np.arange(3), np.full(3, 0.5), np.full(3, 0.4))
    found = recogniser.suggest(among).candidates
    assert [each.place for each in found] == places
    assert all(each.pose.theta_rad == 0.5 for each in found)
