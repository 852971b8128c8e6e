"""Signatures of places: the square difference by FFT against loops, and what turning may change."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.places.signatures import (
    Signature,
    SignatureConfig,
    SignatureIndex,
    histograms,
    signature_of,
)

CONFIG = SignatureConfig(bearings=24, max_range_m=4.0, depth_sigma_m=0.15, least_seen=0.3)


def made(seed, *, unseen=0.0, config=CONFIG):
    """Return a random signature; bearings are heard, silent, both, or not seen."""
    rng = np.random.default_rng(seed)
    n = config.bearings
    silence = rng.choice([0.0, 0.3, 1.0], n)
    silence[rng.random(n) < unseen] = np.nan
    depth = np.where(silence < 1.0, rng.uniform(0.1, 3.9, n), np.nan)
    return Signature(depth, silence)


def rolled(signature, shift):
    """Return what a robot hears that is turned by so many bearings to the left."""
    return Signature(np.roll(signature.depth_m, -shift), np.roll(signature.silence, -shift))


def textbook(old, new, config=CONFIG):
    """Return D at each shift by its formula, bearing by bearing."""
    a, b, n = histograms(old, config), histograms(new, config), config.bearings
    found = []
    for shift in range(n):
        pairs = [((i + shift) % n, i) for i in range(n)]
        pairs = [(i, j) for i, j in pairs if old.seen[i] and new.seen[j]]
        terms = [0.5 * sum((a[i, z] - b[j, z]) ** 2 for z in range(a.shape[1])) for i, j in pairs]
        enough = len(terms) >= config.least_seen * n
        found.append(sum(terms) / len(terms) if enough else math.inf)
    return found


@pytest.mark.parametrize("unseen", [0.0, 0.4])
def test_the_difference_at_each_shift_is_that_of_a_loop_over_bearings_and_classes(unseen):
    known = [made(seed, unseen=unseen) for seed in range(3)]
    new = made(9, unseen=unseen)
    found = SignatureIndex(known, CONFIG).compare(new).differences()
    assert np.allclose(found, [textbook(each, new) for each in known], atol=1e-12)
    assert np.isinf(found).any() == (unseen > 0.0)


@given(seed=st.integers(0, 10_000), shift=st.integers(0, 23))
def test_a_turned_robot_is_found_at_its_shift_with_no_difference(seed, shift):
    signature = made(seed)
    (curve,) = SignatureIndex([signature], CONFIG).compare(rolled(signature, shift)).differences()
    assert curve[shift] == pytest.approx(0.0, abs=1e-12)


@given(seed=st.integers(0, 10_000), shift=st.integers(0, 23))
def test_the_depth_histogram_does_not_change_with_rotation(seed, shift):
    signature = made(seed)
    before, after = (histograms(each, CONFIG) for each in (signature, rolled(signature, shift)))
    assert np.allclose(before.mean(axis=0), after.mean(axis=0), atol=1e-15)
    index = SignatureIndex([signature], CONFIG)
    assert index.compare(rolled(signature, shift)).bounds()[0] == pytest.approx(0.0, abs=1e-15)


@given(seed=st.integers(0, 10_000), unseen=st.sampled_from([0.0, 0.2]))
def test_no_shift_differs_by_less_than_the_depth_histograms_say(seed, unseen):
    known, new = made(seed, unseen=unseen), made(seed + 1, unseen=unseen)
    index = SignatureIndex([known], CONFIG)
    assert index.compare(new).bounds()[0] <= index.compare(new).differences().min() + 1e-12


def test_without_missing_bearings_the_bound_says_something():
    bounds = [SignatureIndex([made(k)], CONFIG).compare(made(k + 1)).bounds()[0] for k in range(20)]
    assert min(bounds) > 0.0


@given(seed=st.integers(0, 10_000))
def test_differences_lie_between_0_and_1_and_are_alike_both_ways_round(seed):
    a, b = made(seed, unseen=0.2), made(seed + 1, unseen=0.2)
    (there,) = SignatureIndex([a], CONFIG).compare(b).differences()
    (back,) = SignatureIndex([b], CONFIG).compare(a).differences()
    assert np.all((there >= 0.0) & ((there <= 1.0) | np.isinf(there)))
    assert np.allclose(there, np.roll(back[::-1], 1), atol=1e-12)


@pytest.mark.parametrize("apart_m", [0.02, 0.1, 0.2, 0.4])
def test_echoes_apart_differ_by_the_overlap_of_their_gaussians(apart_m):
    n, sigma = CONFIG.bearings, CONFIG.depth_sigma_m
    near, far = (Signature(np.full(n, d), np.zeros(n)) for d in (2.0, 2.0 + apart_m))
    found = SignatureIndex([near], CONFIG).compare(far).differences().min()
    assert found == pytest.approx(1.0 - math.exp(-(apart_m**2) / (4.0 * sigma**2)), abs=2e-3)


def test_silence_and_an_echo_have_nothing_in_common_however_far_the_echo():
    n = CONFIG.bearings
    silent = Signature(np.full(n, np.nan), np.ones(n))
    for depth in (0.1, 2.0, 3.99):
        heard = Signature(np.full(n, depth), np.zeros(n))
        assert SignatureIndex([silent], CONFIG).compare(heard).differences().min() == pytest.approx(
            1.0
        )


def test_only_the_chosen_ones_are_compared():
    known = [made(seed) for seed in range(5)]
    index = SignatureIndex(known, CONFIG)
    chosen = index.compare(made(7)).differences(np.array([3, 1]))
    assert np.array_equal(chosen, index.compare(made(7)).differences()[[3, 1]])


@given(seed=st.integers(0, 10_000), count=st.integers(1, 400))
def test_a_signature_has_the_median_echo_and_the_share_of_silence_of_each_bearing(seed, count):
    rng = np.random.default_rng(seed)
    bearings = rng.uniform(-10.0, 10.0, count)
    depths = rng.uniform(0.1, 6.0, count)
    depths[rng.random(count) < 0.2] = np.inf
    depths[rng.random(count) < 0.2] = np.nan
    found = signature_of(bearings, depths, CONFIG)
    for i in range(CONFIG.bearings):
        low, high = math.tau * i / CONFIG.bearings, math.tau * (i + 1) / CONFIG.bearings
        here = [d for b, d in zip(bearings, depths, strict=True) if low <= b % math.tau < high]
        here = [d for d in here if not math.isnan(d)]
        echoes = sorted(d for d in here if d < CONFIG.max_range_m)
        if not here:
            assert math.isnan(found.silence[i])
        else:
            assert found.silence[i] == pytest.approx(1.0 - len(echoes) / len(here))
        if echoes:
            assert found.depth_m[i] == echoes[(len(echoes) - 1) // 2]
        else:
            assert math.isnan(found.depth_m[i])


@pytest.mark.parametrize(
    ("depth", "silence", "says"),
    [
        ([1.0, 2.0], [0.0], r"\(n,\)"),
        ([-1.0], [0.0], "depth_m"),
        ([math.inf], [0.0], "depth_m"),
        ([1.0], [1.5], "silence"),
        ([1.0], [1.0], "contradict"),
        ([math.nan], [0.2], "contradict"),
        ([1.0], [math.nan], "contradict"),
    ],
)
def test_values_that_are_no_signature_are_refused(depth, silence, says):
    with pytest.raises(ValueError, match=says):
        Signature(np.array(depth), np.array(silence))


def test_signatures_of_different_resolution_are_not_compared():
    other = SignatureConfig(bearings=36)
    with pytest.raises(ValueError, match="36 bearings, 24 allowed"):
        SignatureIndex([made(1)], CONFIG).compare(made(1, config=other)).differences()


@pytest.mark.parametrize(
    "wrong", [{"bearings": 7}, {"max_range_m": 0.0}, {"depth_sigma_m": math.inf}, {"least_seen": 0}]
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SignatureConfig(**wrong)
