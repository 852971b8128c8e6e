"""Limits of ranges, found in readings of which the truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.ranging.fit.range_limits import greatest_range, incidence_limit
from robotctl.estimation.ranging.range_mixture import BeamMixture

MIXTURE = BeamMixture(0.9, 0.04, 0.03, 0.03, 0.01, 0.004, 0.8, 0.01)


def echoes(limit_deg: float, n: int, rng: np.random.Generator, fades_deg: float = 0.0):
    """Incidences and whether each has an echo."""
    angles = np.radians(rng.uniform(0.0, 75.0, n))
    away = np.degrees(angles) - limit_deg
    share = (
        np.where(away < 0.0, 1.0, 0.0) if fades_deg == 0.0 else 1 / (1 + np.exp(away / fades_deg))
    )
    return angles, rng.random(n) < 0.02 + 0.95 * share


@pytest.mark.parametrize("n", [60, 2000])
def test_a_sharp_incidence_limit_lies_in_its_interval(n):
    missed, widths = 0, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        limit = rng.uniform(20.0, 50.0)
        found = incidence_limit(*echoes(limit, n, rng)).limit
        missed += not found.low <= math.radians(limit) <= found.high
        widths.append(math.degrees(found.high - found.low))
    # 3 of 60 are to be missed; more than 8 once in 150 runs.
    assert missed <= 8
    # About four mean distances between readings.
    assert np.median(widths) < 6.0 * 75.0 / n


def test_a_sensor_that_fades_out_is_told_from_a_sharp_limit():
    missed = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        found = incidence_limit(*echoes(35.0, 2000, rng, fades_deg=4.0))
        assert math.degrees(found.fades_rad) == pytest.approx(4.0, rel=0.4)
        missed += not found.limit.low <= math.radians(35.0) <= found.limit.high
    assert missed <= 2
    rng = np.random.default_rng(1)
    assert incidence_limit(*echoes(35.0, 2000, rng)).fades_rad == 0.0


@pytest.mark.parametrize("greatest_deg", [20.0, 34.0])
def test_a_limit_beyond_all_incidences_is_not_told_but_bounded(greatest_deg):
    rng = np.random.default_rng(8)
    angles, heard = echoes(35.0, 4000, rng)
    seen = angles < math.radians(greatest_deg)
    found = incidence_limit(angles[seen], heard[seen]).limit
    assert "the limit is above" in found.why_not
    assert found.low < math.radians(35.0) < found.high


def test_a_room_smaller_than_the_range_does_not_tell_it():
    rng = np.random.default_rng(9)
    expected = rng.uniform(0.5, 2.5, 500)
    found = greatest_range(expected, expected, MIXTURE)
    assert "at least" in found.why_not
    assert found.high == math.inf
    with pytest.raises(ValueError, match="no reading"):
        greatest_range(expected, np.full(500, np.inf), MIXTURE)
    with pytest.raises(ValueError, match="no reading"):
        incidence_limit(np.empty(0), np.empty(0, bool))
