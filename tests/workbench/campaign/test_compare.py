from math import comb

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.workbench.campaign.compare import BETTER, PASSING, SAME, WORSE, compare
from tests.workbench.campaign.reports import head, result

CRITERIA = ("time_s <= 12",)


def folder(seed, gain=1.0, count=100, slower=0.0, wall=None):
    """Return the results of a campaign whose runs depend on world and seed, and on the gain."""
    rng = np.random.default_rng(seed)
    results = []
    for number in range(1, count + 1):
        factors = {"world": ("hall", "flat")[number % 2], "gain": gain, "seed": number // 2}
        time_s = float(rng.normal(11.0, 1.0)) + slower * float(rng.normal(1.0, 0.5))
        clearance = 0.5 if wall is None else wall
        results.append(result(number, None, factors) if number == 7 else result(
            number, True, factors, time_s=time_s, min_clearance_m=clearance
        ))  # fmt: skip
    return head(count, *CRITERIA), results


def verdicts(comparison):
    return {each.field: each.verdict for each in comparison.differences}


def test_two_equal_campaigns_show_no_difference_twenty_times_of_twenty():
    for seed in range(20):
        found = compare(folder(seed), folder(seed))
        assert {*verdicts(found).values()} == {SAME}
        assert all(each.interval == (0.0, 0.0) for each in found.differences)
        assert found.unpaired == 0


def test_a_gain_that_makes_runs_slower_is_found_with_its_interval():
    found = compare(folder(1), folder(1, gain=0.9, slower=0.3, wall=0.6))
    assert verdicts(found)["time_s"] == WORSE
    assert verdicts(found)["min_clearance_m"] == BETTER
    of_time = next(each for each in found.differences if each.field == "time_s")
    assert of_time.pairs == 99
    assert of_time.interval[0] < 0.3 < of_time.interval[1]
    assert of_time.interval[1] - of_time.interval[0] < 0.2
    assert all(each.report["time_s"] > 12.0 for each in found.broken)


def test_passing_is_compared_by_the_exact_test_of_mcnemar():
    first, second = folder(3), folder(3, slower=1.0)
    found = compare(first, second)
    of_passing = found.differences[0]
    pairs = [
        (a.report["time_s"] <= 12.0, b.report["time_s"] <= 12.0)
        for a, b in zip(first[1], second[1], strict=True)
        if a.report
    ]
    broken, mended = pairs.count((True, False)), pairs.count((False, True))
    assert (of_passing.field, of_passing.more, of_passing.less) == (PASSING, mended, broken)
    total = broken + mended
    tail = sum(comb(total, k) for k in range(min(broken, mended) + 1))
    exact = min(1.0, 2.0 * tail / 2.0**total)
    # Benjamini and Hochberg: at least as much as alone, at most as by Bonferroni.
    assert exact * 0.999 <= of_passing.p <= exact * len(found.differences) * 1.001
    assert of_passing.verdict == WORSE
    assert len(found.broken) == broken


def test_noise_of_other_seeds_is_hardly_ever_taken_for_a_difference():
    wrong = sum(
        {*verdicts(compare(folder(s), folder(s + 100))).values()} != {SAME} for s in range(30)
    )
    assert wrong <= 4


def test_runs_that_cannot_be_told_apart_or_have_no_like_are_refused():
    twice = folder(1)
    twice[1][3] = result(4, True, {**twice[1][1].factors}, time_s=1.0)
    with pytest.raises(ConfigError, match="runs 2 and 4 differ in nothing"):
        compare(twice, folder(1))
    elsewhere = folder(1)
    for each in elsewhere[1]:
        each.factors["seed"] += 1000
    with pytest.raises(ConfigError, match="no run of one has its like"):
        compare(folder(1), elsewhere)
