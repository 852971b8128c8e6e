"""Meetings in a corridor of 1 m with somebody who looks at nothing."""

from pathlib import Path

import pytest

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from tools.meetings import LIDAR_BEAMS, write

MCL = ('localisation.method="mcl"',)
LIDAR = (f"simulation.lidar.beams={LIDAR_BEAMS}",)
HEAD_ON, BEHIND = 7, 30
"""One in the lane at a wall, each, which leaves room at the other."""


@pytest.mark.parametrize("number", [HEAD_ON, BEHIND])
def test_who_leaves_room_is_let_pass(tmp_path: Path, number: int) -> None:
    case = write(tmp_path, number, 1)
    mission, robot = tmp_path / case["mission"], find_file(case["robot"])
    report = run_lockstep(
        SimOptions(
            robot,
            mission,
            seed=case["seed"],
            max_seconds=120.0,
            overrides=LIDAR,
            localisation=MCL,
        )
    )
    assert report.mission_completed
    assert (report.collisions, report.ran_into) == (0, 0)
