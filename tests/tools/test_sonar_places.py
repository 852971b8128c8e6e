"""Signatures on a real ring of 24 sonars, and on a made-up one."""

import gzip

import numpy as np
import pytest

from robotctl.estimation.places.signatures import Signature, SignatureIndex, histograms
from sonar_places import CONFIG, FILE, Ring, likeness, read_ring, revisits, round_rows, turned

RECORDED = f"sonar/{FILE}"


@pytest.fixture(scope="module")
def ring(recordings):
    return read_ring(recordings / "sonar")


def reindexed(signature, k):
    """Return what a ring hears whose sonars are counted from the k-th on."""
    return Signature(np.roll(signature.depth_m, -k), np.roll(signature.silence, -k))


@pytest.mark.recordings(RECORDED)
def test_a_ring_counted_from_another_sonar_has_the_same_depth_histogram_and_is_found_turned(ring):
    index = SignatureIndex(ring.signatures[::100], CONFIG)
    for i, signature in enumerate(ring.signatures[::100]):
        for k in range(24):
            again = reindexed(signature, k)
            before, after = (histograms(each, CONFIG) for each in (signature, again))
            assert np.array_equal(np.sort(before, axis=0), np.sort(after, axis=0))
            assert index.compare(again).bounds()[i] == pytest.approx(0.0, abs=1e-15)
            (curve,) = index.compare(again).differences(np.array([i]))
            assert curve[k] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.recordings(RECORDED)
def test_a_robot_that_was_told_to_turn_right_is_found_turned_right(ring):
    plain, best, shift = turned(ring, "Sharp-Right-Turn", 18).T
    assert np.mean(shift < 0) > 0.85
    assert np.mean(shift > 0) < 0.05
    assert np.median(best) < 0.6 * np.median(plain)


@pytest.mark.recordings(RECORDED)
def test_left_turns_are_found_to_the_left_and_going_straight_is_not_turning(ring):
    left = turned(ring, "Slight-Left-Turn", 18)[:, 2]
    assert np.mean(left > 0) > 0.6
    assert np.mean(left < 0) < 0.05
    straight = turned(ring, "Move-Forward", 9)[:, 2]
    assert np.mean(straight == 0) > 0.9


@pytest.mark.recordings(RECORDED)
def test_places_of_one_round_are_recognised_in_the_others_and_nowhere_else(ring):
    rows = round_rows(ring)
    assert 800 < rows < 1000
    again = revisits(ring, rows)
    assert len(again.places) > 100
    assert len(set(again.places.tolist())) >= 6
    assert again.right > 0.95


def write_rounds(folder, rows, rounds=4):
    """Write a recording of rounds through a made-up room, in the format of the real one."""
    rng = np.random.default_rng(2)
    bearing = np.arange(24) * 2.0 * np.pi / 24.0
    waves = [(p, q, *rng.uniform((0.1, 0.0), (0.5, 7.0))) for p in range(4) for q in range(1, 5)]
    lines = ["S1,OUTPUT"]
    for i in range(rows * rounds):
        phase = 2.0 * np.pi * i / rows
        depth = 1.8 + 0.01 * rng.standard_normal(24)
        for p, q, height, begin in waves:
            depth += height * np.cos(p * phase + q * bearing + begin)
        words = [f"{max(value, 0.2) if value < 2.6 else 5.0:.3f}" for value in depth]
        lines.append(",".join([*words, "Turn" if i % 2 else "Rest"]))
    with gzip.open(folder / FILE, "wt") as file:
        file.write("\n".join(lines) + "\n")


def test_made_up_rounds_are_found_with_their_length(tmp_path):
    write_rounds(tmp_path, 600)
    made = read_ring(tmp_path)
    assert len(made.signatures) == 2400
    assert set(made.labels.tolist()) == {"Turn", "Rest"}
    assert round_rows(made) == 600
    assert revisits(made, 600).right == 1.0


def test_likeness_is_alike_both_ways_round_and_nothing_differs_from_itself(tmp_path):
    write_rounds(tmp_path, 600, rounds=1)
    found = likeness(read_ring(tmp_path), 40)
    assert np.allclose(found, found.T, atol=1e-12)
    assert np.allclose(np.diagonal(found), 0.0, atol=1e-12)


def test_only_rows_of_one_label_are_compared():
    n = CONFIG.bearings
    plain = Signature(1.0 + 0.1 * np.arange(n), np.zeros(n))
    rows = tuple(reindexed(plain, k) for k in (0, 1, 2, 3))
    ring = Ring(rows, np.array(["a", "a", "a", "b"]))
    assert turned(ring, "a", 1)[:, 2].tolist() == [1.0, 1.0]
    assert turned(ring, "a", 2)[:, 2].tolist() == [2.0]
