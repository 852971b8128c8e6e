import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.cli.campaign.summary_view import page_of
from robotctl.workbench.campaign.statistics import Rate, is_better, summarise
from tests.workbench.campaign.reports import head, result

Z = 1.959963984540054


@given(st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_of_a_rate_is_wilsons_formula(counts):
    count, total = counts
    share = count / total
    middle = (share + Z * Z / (2 * total)) / (1 + Z * Z / total)
    half = Z / (1 + Z * Z / total)
    half *= math.sqrt(share * (1 - share) / total + Z * Z / (4 * total * total))
    low, high = Rate(count, total).interval
    assert low == pytest.approx(max(0.0, middle - half), abs=1e-9)
    assert high == pytest.approx(min(1.0, middle + half), abs=1e-9)


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    # Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_the_interval_of_a_rate_is_that_of_a_published_table(count, total, low, high):
    assert Rate(count, total).interval == pytest.approx((low, high), abs=5e-5)


def campaign(pass_of, count=80):
    """Return the summary of runs with two factors, of which `pass_of` may use any."""
    rng = np.random.default_rng(3)
    results = []
    for number in range(1, count + 1):
        factors = {
            "robot": ("a", "b")[number % 2],
            "gain": float(rng.uniform(1.0, 2.0)),
            "one": "same",
            "seed": number,
        }
        time_s = float(rng.normal(10.0, 1.0))
        results.append(result(number, bool(pass_of(factors)), factors, time_s=time_s))
    return summarise(head(count), results)


def test_what_matters_is_found_and_what_does_not_is_not():
    of_robot = campaign(lambda each: each["robot"] == "a" or each["seed"] % 3)
    sure = [each for each in of_robot.effects if each.p < 0.05]
    assert [(each.factor, each.of) for each in sure] == [("robot", "")]
    passed = of_robot.rate.count
    assert sure[0].levels == (("b", f"{passed - 40}/40"), ("a", "40/40"))
    of_gain = campaign(lambda each: each["gain"] < 1.7)
    sure = [each for each in of_gain.effects if each.p < 0.05]
    assert [(each.factor, each.of) for each in sure] == [("gain", "")]
    assert [level for level, _ in sure[0].levels] == [
        "1..1.25",
        "1.25..1.5",
        "1.5..1.75",
        "1.75..2",
    ]
    assert sure[0].levels[-1][1].startswith("0/")


def test_seeds_alone_show_no_effect():
    rng = np.random.default_rng(5)
    found = [
        min((each.p for each in campaign(lambda _: rng.random() < 0.7).effects), default=1.0)
        for _ in range(40)
    ]
    assert sum(each < 0.05 for each in found) <= 6  # 2 are to be expected


def test_runs_without_a_result_count_neither_way():
    results = [result(1, True, {}), result(2, False, {}), result(3, None, {})]
    summary = summarise(head(3), results)
    assert (summary.rate.count, summary.rate.total) == (1, 2)
    assert [each.result.number for each in summary.failures] == [2]
    assert [each.result.number for each in summary.without_result] == [3]


def test_the_worst_runs_are_those_with_most_error_and_least_clearance():
    results = [
        result(number, True, {}, min_clearance_m=clearance, pose_error={"rmse_m": error})
        for number, (clearance, error) in enumerate([(0.3, 0.01), (0.1, 0.02), (0.2, 0.03)], 1)
    ]
    worst = {field: each.number for field, each in summarise(head(3), results).worst}
    assert worst == {"min_clearance_m": 2, "pose_error.rmse_m": 3}
    assert is_better("min_clearance_m", 0.1)
    assert not is_better("pose_error.rmse_m", 0.1)


def test_no_runs_are_shown_as_such():
    summary = summarise(head(0), [])
    assert (summary.effects, summary.distributions, str(summary.rate)) == ((), (), "none")


def test_each_name_of_a_case_has_its_own_criteria_rate_and_distributions():
    both = msgspec.structs.replace(
        head(4), case_criteria={"faults": ("mission_completed = false",)}
    )
    results = [
        result(number, number == 1, {"case": case, "seed": number}, time_s=float(number))
        for number, case in enumerate(("missions", "missions", "faults", "faults"), 1)
    ]
    summary = summarise(both, results)
    assert {case: (each.count, each.total) for case, each in summary.case_rates.items()} == {
        "missions": (1, 2),
        "faults": (2, 2),
    }
    assert (summary.rate.count, summary.rate.total) == (3, 4)
    assert [(each.case, each.quantile(1.0)) for each in summary.distributions] == [
        ("missions", 2.0),
        ("faults", 4.0),
    ]
    page = page_of(summary)
    assert "faults: 2 of 2, 100 % (95 %: 34.2 to 100 %); passes with: mission_completed" in page
    assert "a run passes with: mission_completed = true" in page


def test_a_factor_with_a_value_for_each_run_is_not_looked_at():
    results = [
        result(n, n > 4, {"mission": f"m{n}", "robot": "ab"[n % 2], "seed": 1}) for n in range(9)
    ]
    assert {each.factor for each in summarise(head(9), results).effects} == {"robot"}
