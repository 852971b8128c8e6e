"""Missions drawn by seed: all kinds of robots in turn, goals in reach, and their score."""

import math

import pytest

from tools.missions import DRIVES, Result, draw, summaries

REPORT = {
    "arrived": True,
    "time_s": 12.0,
    "best_s": 8.0,
    "min_clearance_m": 0.1,
    "collisions": 0,
    "ran_into": 1,
    "near_misses": 0,
    "plans": 2,
    "recoveries": 0,
    "message": "",
}


def test_a_number_is_always_the_same_mission_and_six_have_all_kinds():
    cases = [draw(number, 0, 0) for number in range(6)]
    assert draw(3, 0, 0) == cases[3]
    assert {(case.drive, case.lidar) for case in cases} == {
        (drive, lidar) for drive in DRIVES for lidar in (True, False)
    }
    for case in cases:
        assert 2.5 <= math.dist(case.start[:2], case.goal) <= 8.0
        assert f"--goal {case.goal[0]:g},{case.goal[1]:g}" in " ".join(case.words())


def test_who_does_not_arrive_has_no_time_and_is_said_why():
    case = draw(1, 0, 0)
    good = Result(case, REPORT)
    bad = Result(case, {**REPORT, "arrived": False, "collisions": 2, "message": "no way"})
    assert good.ratio == pytest.approx(1.5)
    assert bad.row().endswith("no way")
    assert summaries([good, bad]).splitlines()[-1] == (
        "all: 1 of 2 arrived, 2 collisions in 1 missions, time / best 1.50 in the median, 1.50 p90"
    )
