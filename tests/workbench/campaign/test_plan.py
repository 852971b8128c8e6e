from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.workbench.campaign.campaign_file import Campaign, Range, Sample, setting
from robotctl.workbench.campaign.plan import plan, sampled


@given(points=st.integers(1, 60), seed=st.integers(0, 1000), log=st.booleans())
def test_a_latin_hypercube_has_one_point_in_each_of_the_equal_parts_of_each_range(
    points, seed, log
):
    ranges = [Range("a", 1.0, 4.0, log), Range("b", 10.0, 20.0)]
    found = sampled(ranges, Sample(points, seed=seed))
    a, b = (np.array([each[key] for each in found]) for key in "ab")
    shares = [np.log(a) / np.log(4.0) if log else (a - 1.0) / 3.0, (b - 10.0) / 10.0]
    for share in shares:
        # Values are rounded to nine figures, which may move one across an edge.
        part = np.sort(share) * points - np.arange(points)
        assert np.all((part > -1e-5) & (part < 1.0 + 1e-5))


def test_a_range_of_whole_numbers_has_whole_numbers_each_as_often():
    found = [each["n"] for each in sampled([Range("n", 3, 6)], Sample(400, "random"))]
    assert all(isinstance(each, int) for each in found)
    counts = np.bincount(found)[3:]
    assert len(counts) == 4
    assert counts.min() > 70


def test_a_sample_depends_on_its_seed_alone():
    ranges = [Range("a", 0.0, 1.0)]
    for method in ("random", "latin_hypercube"):
        assert sampled(ranges, Sample(5, method, 1)) == sampled(ranges, Sample(5, method, 1))
        assert sampled(ranges, Sample(5, method, 1)) != sampled(ranges, Sample(5, method, 2))


def test_every_combination_is_driven_with_the_first_seed_then_with_the_next():
    campaign = Campaign(
        robots=("diff_drive", "jackal"),
        faults=("", "bus"),
        options=("", "--people 2"),
        set={"control": {"left": {"kp": [1.0, 2.0]}}, "limits": {"v_max_m_s": 0.5}},
        seeds=(7, 9),
    )
    runs = plan(campaign)
    keys = ("robot", "faults", "options", "control.left.kp")
    wanted = product((7, 9), ("diff_drive", "jackal"), ("", "bus"), ("", "--people 2"), (1.0, 2.0))
    assert [(each.factors["seed"], *(each.factors[key] for key in keys)) for each in runs] == [
        *wanted
    ]
    assert runs[7].command == (
        "robotctl sim --lockstep --robot diff_drive --faults bus --people 2 "
        "--set control.left.kp=2.0 --set limits.v_max_m_s=0.5 --max-seconds 300 --seed 7"
    )


def test_of_too_many_runs_so_many_are_drawn_without_one_twice():
    runs = plan(Campaign(seeds=500, runs=50))
    seeds = [each.factors["seed"] for each in runs]
    assert len(set(seeds)) == 50
    assert seeds == sorted(seeds)
    assert max(seeds) > 250
    assert [each.number for each in runs] == [*range(1, 51)]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (True, "true"),
        (2, "2"),
        (0.1, "0.1"),
        (float("inf"), "inf"),
        ("mcl", '"mcl"'),
        (["sonar", "lidar"], '["sonar", "lidar"]'),
        ({"x_m": 1.0}, "{x_m = 1.0}"),
    ],
)
def test_a_setting_is_written_as_set_takes_it(value, text):
    assert setting("a.b", value) == f"a.b={text}"
