"""Bayes filter, Gaussians and likelihoods: laws, and two small stories."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from robotctl.estimation.bayes import (
    DiscreteBayes,
    Gaussian,
    fuse,
    gaussian_likelihood,
    robust_likelihood,
    shift_transition,
)

# A corridor of twelve cells with three doors: only one pair of them is three cells apart.
DOORS = np.isin(np.arange(12), [1, 4, 9])
SEES_DOOR = np.where(DOORS, 0.8, 0.1)
SEES_WALL = 1.0 - SEES_DOOR
NEARLY = [0.1, 0.8, 0.1]


class Corridor:
    """A robot that does not know where it is in a corridor with doors."""

    def __init__(self):
        self.filter = DiscreteBayes(np.ones(12))

    def sees_door(self):
        self.filter.update(SEES_DOOR)
        return self

    def sees_wall(self):
        self.filter.update(SEES_WALL)
        return self

    def drives(self, cells):
        self.filter.predict(shift_transition(12, cells, NEARLY))
        return self

    @property
    def most_likely(self):
        return int(np.argmax(self.filter.belief))


def test_a_door_makes_three_places_equally_likely():
    belief = Corridor().sees_door().filter.belief
    assert belief[DOORS] == pytest.approx(0.8 / (3 * 0.8 + 9 * 0.1))
    assert belief[~DOORS] == pytest.approx(0.1 / (3 * 0.8 + 9 * 0.1))


def test_a_second_door_three_cells_on_tells_which_it_was():
    robot = Corridor().sees_door().drives(3).sees_door()
    assert robot.most_likely == 4
    assert robot.filter.belief[4] > 0.5


def test_driving_on_blurs_and_seeing_sharpens():
    robot = Corridor().sees_door().drives(3).sees_door()
    sharp = robot.filter.belief.max()
    robot.drives(2).drives(2)
    assert robot.filter.belief.max() < sharp
    blurred = robot.filter.belief.max()
    robot.sees_wall().drives(1).sees_door()
    assert robot.most_likely == 9
    assert robot.filter.belief.max() > blurred


def test_a_robot_that_is_wrong_about_its_place_finds_out():
    robot = Corridor()
    robot.filter = DiscreteBayes([1e-4] * 6 + [1.0] + [1e-4] * 5)
    robot.sees_door().drives(3).sees_door().drives(2).sees_wall().drives(3).sees_door()
    for _ in range(3):
        robot.sees_door()
    assert robot.most_likely == 9


@given(
    st.lists(st.floats(0.01, 1.0), min_size=4, max_size=4),
    st.lists(st.floats(0.01, 1.0), min_size=4, max_size=4),
)
def test_bayes_rule_is_the_textbook_loop_and_the_order_of_measurements_is_free(first, second):
    prior = [0.1, 0.2, 0.3, 0.4]
    one, other = DiscreteBayes(prior), DiscreteBayes(prior)
    evidence = one.update(first)
    assert evidence == pytest.approx(sum(p * q for p, q in zip(prior, first, strict=True)))
    assert one.belief == pytest.approx(
        [p * q / evidence for p, q in zip(prior, first, strict=True)]
    )
    one.update(second)
    other.update(second)
    other.update(first)
    np.testing.assert_allclose(one.belief, other.belief, rtol=1e-12)


@given(steps=st.integers(-15, 15), circular=st.booleans())
def test_a_motion_keeps_all_probability_and_an_exact_one_shifts_it(steps, circular):
    transition = shift_transition(8, steps, NEARLY, circular)
    np.testing.assert_allclose(transition.sum(axis=0), 1.0)
    exact = shift_transition(8, steps, [1.0], circular)
    belief = DiscreteBayes([0, 0, 0, 1, 0, 0, 0, 0]).predict(exact)
    expected = (3 + steps) % 8 if circular else min(max(3 + steps, 0), 7)
    assert belief[expected] == 1.0


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: DiscreteBayes([0.0, 0.0]), "0 everywhere"),
        (lambda: DiscreteBayes([0.5, -0.5]), "not negative"),
        (lambda: DiscreteBayes([1.0, 1.0]).predict(np.ones((2, 2))), "columns"),
        (lambda: DiscreteBayes([1.0, 1.0]).predict(np.eye(3)), "columns"),
        (lambda: DiscreteBayes([1.0, 0.0]).update([0.0, 1.0]), "impossible"),
        (lambda: DiscreteBayes([1.0, 0.0]).update([1.0]), "likelihood must be"),
        (lambda: shift_transition(5, 1, [0.5, 0.5]), "odd number"),
        (lambda: Gaussian(0.0, 0.0), "variance > 0"),
        (lambda: fuse([]), "nothing to fuse"),
    ],
)
def test_what_makes_no_sense_is_refused(act, said):
    with pytest.raises(ValueError, match=said):
        act()


finite = st.floats(-10.0, 10.0)
positive = st.floats(0.01, 10.0)


@given(finite, positive, finite, positive)
def test_a_product_of_gaussians_is_the_product_of_their_densities(m1, v1, m2, v2):
    a, b = Gaussian(m1, v1), Gaussian(m2, v2)
    product = a * b
    x = np.linspace(product.mean - 3 * product.sigma, product.mean + 3 * product.sigma, 7)
    log_both = norm.logpdf(x, a.mean, a.sigma) + norm.logpdf(x, b.mean, b.sigma)
    off = log_both - norm.logpdf(x, product.mean, product.sigma)
    np.testing.assert_allclose(off, off[0], rtol=1e-6, atol=1e-6)
    assert product.variance < min(v1, v2)


def test_two_rangefinders_agree_on_a_wall():
    """A sonar says 2.10 m to a decimetre, an infrared sensor 2.00 m to half of that."""
    sonar, infrared = Gaussian(2.10, 0.10**2), Gaussian(2.00, 0.05**2)
    wall = sonar * infrared
    assert wall.mean == pytest.approx(2.02)
    assert wall.sigma == pytest.approx(0.1 / math.sqrt(5.0))
    assert fuse([sonar, infrared]).mean == pytest.approx(wall.mean)


def test_odometry_and_rangefinders_follow_a_robot_to_a_wall():
    """Each metre the odometry adds its error, and the range to a wall at 10 m takes it away."""
    rng = np.random.default_rng(7)
    truth, belief, blind = 0.0, Gaussian(0.0, 0.01**2), Gaussian(0.0, 0.01**2)
    normalised = []
    for _ in range(200):
        way = 0.04
        truth += way + 0.01 * rng.standard_normal()
        step = Gaussian(way, 0.01**2)
        belief, blind = belief + step, blind + step
        seen = Gaussian(10.0 - truth + 0.05 * rng.standard_normal(), 0.05**2)
        belief = belief * Gaussian(10.0 - seen.mean, seen.variance)
        normalised.append((belief.mean - truth) / belief.sigma)
    assert blind.sigma == pytest.approx(0.01 * math.sqrt(201))
    assert belief.sigma < 0.03
    assert np.mean(np.square(normalised)) == pytest.approx(1.0, abs=0.5)


def test_fusing_many_is_multiplying_them():
    sources = [Gaussian(1.0, 0.5), Gaussian(1.4, 0.2), Gaussian(0.7, 1.5)]
    product = sources[0] * sources[1] * sources[2]
    assert fuse(sources).mean == pytest.approx(product.mean)
    assert fuse(sources).variance == pytest.approx(product.variance)


@given(finite, finite, positive)
def test_the_gaussian_likelihood_is_scipys_density(z, expected, sigma):
    assert float(gaussian_likelihood(z, expected, sigma)) == pytest.approx(
        norm.pdf(z, expected, sigma)
    )


def test_one_wild_range_ruins_a_gaussian_belief_and_not_a_robust_one():
    """Errata 2.4: exp(...) + K."""
    places = np.linspace(0.0, 5.0, 101)
    good, wild = [2.0, 2.05, 1.95, 2.0], 4.8
    believed = {}
    for name, likelihood in (
        ("gaussian", lambda z: gaussian_likelihood(z, places, 0.1)),
        ("robust", lambda z: robust_likelihood(z, places, 0.1, 0.05)),
    ):
        belief = DiscreteBayes(np.ones(101))
        for z in (*good, wild):
            belief.update(likelihood(z))
        believed[name] = float(belief.belief @ places)
    assert believed["robust"] == pytest.approx(2.0, abs=0.05)
    assert believed["gaussian"] > 2.4
    assert robust_likelihood(9.0, 2.0, 0.1, 0.05) == pytest.approx(0.05)
    assert robust_likelihood(2.0, 2.0, 0.1, 0.05) == pytest.approx(1.05)
