"""Missions drawn by seed: all kinds of robots in turn, goals in reach."""

import argparse
import math

import pytest

from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from tools.case_file import write_cases
from tools.missions import DRIVES, Crowd, draw, parse_people, parse_worlds

NOBODY = Crowd((0, 0), 0)


def test_a_number_is_always_the_same_mission_and_six_have_all_kinds(tmp_path):
    cases = [draw(number, NOBODY) for number in range(6)]
    assert draw(3, NOBODY) == cases[3]
    assert {(case.drive, case.lidar) for case in cases} == {
        (drive, lidar) for drive in DRIVES for lidar in (True, False)
    }
    for case in cases:
        assert 2.5 <= math.dist(case.start[:2], case.goal) <= 8.0
    file = tmp_path / "missions.toml"
    write_cases(file, [case.write(tmp_path) for case in cases])
    runs = plan(load_campaign(file, lambda _: ""))
    assert [run.factors["robot"] for run in runs] == [case.drive for case in cases]
    assert runs[4].command == (
        f"robotctl sim --lockstep --robot tricycle --mission {tmp_path}/mission_004.toml "
        "--localiser mcl --people 0 --clutter 0 --max-seconds 300 --seed 4"
    )
    assert "--set simulation.lidar.beams=360" in runs[2].command


def test_each_manner_is_in_each_world_among_as_many_people_as_asked_for(tmp_path):
    worlds = ("flat", "depot", "corridor_loop")
    crowd = Crowd((3, 6), 0, "each")
    cases = [draw(6 * turn, crowd, worlds) for turn in range(15)]
    assert len({(case.world, case.manner) for case in cases}) == 15
    assert {case.people for case in cases} <= {3, 4, 5, 6}
    assert len({case.people for case in cases}) > 1
    assert cases[0].kind == "stubborn, lidar"
    options = cases[1].write(tmp_path)["options"]
    assert f"--people {cases[1].people} --manner evades --clutter 0" in options


def test_words_that_are_no_number_of_people_no_world_or_no_data_are_told(monkeypatch, tmp_path):
    assert parse_people("3") == (3, 3)
    assert parse_people("3..6") == (3, 6)
    for wrong in ("", "3..", "6..3", "a", "-1"):
        with pytest.raises(argparse.ArgumentTypeError):
            parse_people(wrong)
    with pytest.raises(argparse.ArgumentTypeError, match="allowed are flat, office, depot"):
        parse_worlds("flat,moon")
    monkeypatch.delenv("ROBOTCTL_DATA", raising=False)
    with pytest.raises(argparse.ArgumentTypeError, match="ROBOTCTL_DATA is not set"):
        parse_worlds("warehouse")
    monkeypatch.setenv("ROBOTCTL_DATA", str(tmp_path))
    with pytest.raises(argparse.ArgumentTypeError, match=r"maps/warehouse.yaml"):
        parse_worlds("warehouse")
