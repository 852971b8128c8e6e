"""Lengths that stand for no echo, found in readings of rooms that are made up here."""

import math

import numpy as np
import pytest

from robotctl.logs.formats.no_echo import no_echo_codes

PLACES = np.stack([0.5 * np.arange(200), np.zeros(200)], axis=1)


def drive(code, share=0.02, longest_m=25.0, places=PLACES, seed=1, digits=2):
    """Scans of a drive whose echoes become rarer with their length; `code(rng, n)` for the rest."""
    rng = np.random.default_rng(seed)
    scans = []
    for _ in places:
        ranges = np.minimum(rng.exponential(4.0, 180), longest_m * rng.random(180)).round(digits)
        none = rng.random(180) < share
        scans.append(np.where(none, code(rng, 180), ranges))
    return scans


@pytest.mark.parametrize(
    ("low", "high", "longest_m"),
    [
        (81.83, 81.83, 25.0), (81.83, 81.91, 40.0), (50.0, 50.0, 49.0), (51.05, 51.16, 44.0),
        (32.759, 32.767, 31.0), (30.0, 30.0, 29.99), (8.183, 8.191, 8.0), (79.0, 79.0, 60.0),
        (12.0, 12.05, 9.0), (4.095, 4.095, 4.09), (163.83, 163.83, 30.0), (65.535, 65.535, 20.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("share", [0.005, 0.3])
def test_a_length_at_which_readings_pile_up_is_found(low, high, longest_m, share):
    def code(rng, n):
        return rng.uniform(low, high, n).round(3)

    scans = drive(code, share, longest_m, digits=3)
    (found,) = no_echo_codes(scans, PLACES)
    every = np.concatenate(scans)
    assert found.count == pytest.approx(np.count_nonzero(every >= low), abs=20)
    assert low - 0.011 <= found.low_m <= found.high_m <= high + 0.011
    assert np.count_nonzero((every >= found.reach_m) & (every < low)) <= 20


def test_two_lengths_are_found_with_a_few_echoes_between_and_beyond():
    def code(rng, n):
        return np.where(rng.random(n) < 0.1, 50.0, rng.choice([51.14, 51.15, 51.16], n))

    scans = drive(code, 0.08, 49.0)
    scans[3][:3] = 50.4, 50.95, 51.3
    first, second = no_echo_codes(scans, PLACES)
    assert (first.low_m, first.high_m) == (51.14, 51.16)
    assert (second.low_m, second.high_m) == (50.0, 50.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_log_of_echoes_has_none(seed):
    assert no_echo_codes(drive(lambda rng, n: 5.0 * rng.random(n), seed=seed), PLACES) == ()


def test_the_far_wall_of_a_robot_that_stands_is_none():
    rng = np.random.default_rng(2)
    room = np.where(np.arange(180) < 12, 20.0, rng.uniform(1.0, 9.0, 180))
    scans = [room.copy() for _ in range(500)]
    assert no_echo_codes(scans, np.zeros((500, 2))) == ()


def test_the_end_of_a_corridor_towards_which_the_robot_drives_is_none():
    scans, rng = [], np.random.default_rng(3)
    for x, _ in PLACES:
        angles = np.radians(np.arange(180) - 90.0 + rng.standard_normal())
        with np.errstate(divide="ignore"):
            aside = 1.5 / np.abs(np.sin(angles))
            ahead = (120.0 - x) / np.cos(angles)
        scans.append(np.minimum(aside, ahead).round(2))
    assert no_echo_codes(scans, PLACES) == ()


def test_a_round_room_and_no_reading_at_all_have_none():
    assert no_echo_codes([np.full(180, 4.0)] * 3, PLACES[:3]) == ()
    assert no_echo_codes([np.full(180, math.inf)] * 3, PLACES[:3]) == ()
    assert no_echo_codes([], np.empty((0, 2))) == ()


@pytest.mark.parametrize("longest", [81.91, 51.1, 32.763, 8.19])
def test_of_a_known_code_a_single_reading_is_enough(longest):
    scans = drive(lambda rng, n: rng.uniform(0.5, 7.0, n), 1.0)
    scans[7][3] = longest
    (found,) = no_echo_codes(scans, PLACES)
    assert (found.low_m, found.high_m, found.count) == (longest, longest, 1)
    assert found.reach_m <= longest


def test_a_beam_that_is_always_the_same_has_none_though_it_is_but_one():
    scans = drive(lambda rng, n: 5.0 * rng.random(n), 0.0, 49.0)
    for scan in scans:
        scan[17] = 50.0
    (found,) = no_echo_codes(scans, PLACES)
    assert (found.low_m, found.high_m, found.count) == (50.0, 50.0, 200)


def test_the_side_of_a_corridor_along_which_the_robot_drives_is_none():
    rng = np.random.default_rng(4)
    scans = drive(lambda rng, n: 5.0 * rng.random(n), 0.0, 30.0)
    for scan in scans:
        scan[90:92] = 35.0 + 0.02 * rng.standard_normal(2)
    assert no_echo_codes(scans, PLACES) == ()
