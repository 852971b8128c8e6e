"""Missions drawn by seed: all kinds of robots in turn, goals in reach."""

import math

from robotctl.workbench.campaign.checked_file import load_campaign
from robotctl.workbench.campaign.plan import plan
from tools.case_file import write_cases
from tools.missions import DRIVES, draw


def test_a_number_is_always_the_same_mission_and_six_have_all_kinds(tmp_path):
    cases = [draw(number, 0, 0) for number in range(6)]
    assert draw(3, 0, 0) == cases[3]
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
