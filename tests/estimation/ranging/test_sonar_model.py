"""Sonars on walls and grids: the notes' formulas, a fan of rays, and the simulator's ring."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.estimation.ranging.sonar_model import SonarModel
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap

FAR_M = 4.0
ROOM = WallMap(
    np.array([[0, 0, 3, 0], [3, 0, 3, 2], [3, 2, 0, 2], [0, 2, 0, 0], [1.0, 0, 1.4, 0.5]], float)
)
MOUNTS = [SonarMount("ahead", 0.1, 0.0, 0.0), SonarMount("left", 0.0, 0.1, 90.0)]


def likelihood(config: SonarModelConfig, pose: tuple[float, float, float], z: float) -> float:
    model = SonarModel(ROOM, MOUNTS[:1], config)
    return math.exp(model.log_likelihood(np.array([pose]), np.array([z])).item())


@pytest.mark.parametrize("pose", [(1.7, 1.0, 0.0), (1.7, 1.0, math.radians(50))])
def test_ranges_and_missing_echoes_together_have_probability_1(pose):
    model = SonarModel(ROOM, MOUNTS[:1])
    z = np.linspace(0.0, FAR_M, 4001)[:-1]
    density = [math.exp(model.log_likelihood(np.array([pose]), np.array([r])).item()) for r in z]
    none = math.exp(model.log_likelihood(np.array([pose]), np.array([np.inf])).item())
    assert np.mean(density) * FAR_M + none == pytest.approx(1.0, abs=2e-3)


def test_the_likelihood_is_the_robust_gaussian_where_an_echo_is_due_and_flat_where_none_is():
    config = SonarModelConfig(beam_deg=10.0, sigma_m=0.02, sigma_per_m=0.01, random=0.2, none=0.1)
    due, not_due = (1.7, 1.0, 0.0), (1.7, 1.0, math.radians(45))
    m, k = 1.2, 0.2 / FAR_M
    sigma = 0.02 + 0.01 * m
    for z in (1.2, 1.25, 0.6, 3.0):
        gauss = math.exp(-0.5 * ((z - m) / sigma) ** 2) / (math.sqrt(math.tau) * sigma)
        assert likelihood(config, due, z) == pytest.approx(0.7 * gauss + k, rel=1e-6)
        assert likelihood(config, not_due, z) == pytest.approx(k, rel=1e-6)
    assert likelihood(config, due, math.inf) == pytest.approx(0.1)
    assert likelihood(config, not_due, math.inf) == pytest.approx(0.8)


def test_sonars_are_multiplied_tempered_and_left_out_where_they_say_nothing():
    rng = np.random.default_rng(4)
    poses = rng.uniform([0.3, 0.3, -3], [2.7, 1.7, 3], (50, 3))
    whole = SonarModel(ROOM, MOUNTS, SonarModelConfig(independent_readings=2.0))
    half = SonarModel(ROOM, MOUNTS, SonarModelConfig(independent_readings=1.0))
    both = whole.measurement(np.array([0.9, np.inf]))(poses)
    first = whole.measurement(np.array([0.9, np.nan]))(poses)
    second = whole.measurement(np.array([np.nan, np.inf]))(poses)
    assert np.allclose(both, first + second)
    assert np.allclose(half.measurement(np.array([0.9, np.inf]))(poses), 0.5 * both)
    assert np.array_equal(whole.measurement(np.full(2, np.nan))(poses), np.zeros(50))


def test_forgiven_is_what_is_nearer_than_the_map_allows_and_nothing_else():
    """Half of a perfect reading's likelihood at least, by the formulas of the module."""
    config = SonarModelConfig(beam_deg=10.0)
    model = SonarModel(ROOM, MOUNTS[:1], config)
    here = np.array([[1.7, 1.0, 0.0]])  # 1.2 m before a wall
    across = np.array([[1.7, 1.0, math.radians(45)]])  # where nothing gives an echo

    def lost(pose: np.ndarray, z: float) -> tuple[float, float]:
        measured = model.measurement(np.array([z]))
        return measured(pose).item(), measured.forgiven(pose).item()

    for pose, z in ((here, 0.5), (here, 0.9), (across, 0.5), (across, 2.5)):
        strict, kind = lost(pose, z)
        assert strict < math.log(0.5) - 1.0
        assert kind == pytest.approx(math.log(0.5))
    for pose, z in ((here, 1.2), (here, 1.15), (here, 2.0), (here, np.inf), (across, np.inf)):
        strict, kind = lost(pose, z)
        assert kind == strict
    nothing = model.measurement(np.array([np.nan]))
    assert nothing.forgiven(here).item() == nothing(here).item() == 0.0


def test_two_echoes_of_an_instant_are_forgiven_and_those_that_cost_most():
    """Somebody hides what few sonars look at; a place with nearer walls speaks against the belief.

    The product is not tempered here, so that each sonar's share can be added.
    """
    ring = tuple(SonarMount(f"sonar_{i}", 0.0, 0.0, 90.0 * i) for i in range(4))
    config = SonarModelConfig(beam_deg=10.0, independent_readings=4.0)
    here = np.array([[2.0, 1.0, 0.0]])
    expected = np.array([1.0, 1.0, 2.0, 1.0])
    hidden = expected - np.array([0.3, 0.4, 0.5, 0.6])

    def lost(count):
        readings = np.where(np.arange(4) < count, hidden, expected)
        measured = SonarModel(ROOM, ring, config).measurement(readings)
        return measured(here).item(), measured.forgiven(here).item()

    alone = np.diff([lost(count)[0] for count in range(5)])  # each echo's by itself
    for count in range(5):
        strict, kind = lost(count)
        dearest = np.sort(alone[:count])[:2]
        forgiven = strict - dearest.sum() + len(dearest) * math.log(0.5)
        assert kind == pytest.approx(forgiven)
        assert count < 3 or kind < 2.0 * math.log(0.5) - 1.0


def test_readings_that_are_not_one_for_each_sonar_are_refused():
    with pytest.raises(ValueError, match=r"each of 2 sonars, found \(3,\)"):
        SonarModel(ROOM, MOUNTS).log_likelihood(np.zeros((1, 3)), np.ones(3))


@pytest.mark.parametrize(
    ("key", "value"),
    [("beam_deg", 180.0), ("max_incidence_deg", 0.0), ("sigma_per_m", -0.1), ("none", 0.9)],
)
def test_a_number_out_of_its_range_is_refused_by_name(key, value):
    with pytest.raises(ValueError, match=key):
        SonarModelConfig(**{key: value})
