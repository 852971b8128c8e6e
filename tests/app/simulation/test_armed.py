"""Robots with an arm to one side, through a door that leaves room for it on that side alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotctl.app.scoring.score import Report
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file

WITH_ARM = (
    (0.2, -0.45), (0.2, 0.18), (-0.2, 0.18), (-0.2, -0.18), (0.1, -0.18), (0.1, -0.45),
)  # fmt: skip
DRIVE = 'kind = "drive"\nwaypoints = [[0.8, 0.0], [3.2, 0.0]]'
GOTO = 'kind = "goto"\nx_m = 3.2\ny_m = 0.0'


POST = '[[furniture]]\nkind = "pillar"\ncentre = [0.7, -0.33]\nradius_m = 0.05\n'
"""In the hollow behind the arm, where the robot starts."""


def through_a_door(
    folder: Path, door: tuple[float, float], arm: float, item: str, things: str = ""
) -> Report:
    """Drive from one room to another; the arm is to the right, or with -1 to the left."""
    low, high = door
    walls = [
        [0, -2], [2, -2], [2, low], [2.1, low], [2.1, -2], [4.1, -2], [4.1, 2], [2.1, 2],
        [2.1, high], [2, high], [2, 2], [0, 2],
    ]  # fmt: skip
    start = "start = { x_m = 0.8, y_m = 0.0, heading_deg = 0.0 }"
    (folder / "door.toml").write_text(
        f'[world]\nname = "door"\nbounds = [0, -2, 4.1, 2]\n{start}\n'
        f"[[wall]]\npoints = {json.dumps(walls)}\nclosed = true\n{things}"
    )
    mission = folder / "mission.toml"
    mission.write_text(f'name = "door"\nworld = "door.toml"\n{start}\n[[item]]\n{item}\n')
    believed = [[x, arm * y] for x, y in WITH_ARM]
    true = [[x - 0.005 * (1 if x > 0.15 else -1), y * 0.99] for x, y in believed]
    overrides = (
        f"body.outline={json.dumps(believed)}",
        f"simulation.body={json.dumps(true)}",
        "simulation.lidar.beams=360",
    )
    return run_lockstep(
        SimOptions(find_file("diff_drive"), mission, seed=3, max_seconds=60.0, overrides=overrides)
    )


@pytest.mark.parametrize("arm", [1.0, -1.0])
def test_a_door_is_passed_where_the_arm_has_room_and_its_twin_stands_before_it(
    arm: float, tmp_path: Path
) -> None:
    room = (-0.65, 0.38) if arm > 0.0 else (-0.38, 0.65)
    passed = through_a_door(tmp_path, room, arm, DRIVE)
    assert passed.mission_completed
    assert passed.collisions == 0
    assert (passed.min_clearance_m or 0.0) > 0.15
    stopped = through_a_door(tmp_path, room, -arm, DRIVE)
    assert not stopped.mission_completed
    assert stopped.collisions == 0
    assert "blocked" in stopped.message


def test_with_a_plan_it_passes_the_door_of_its_twin_as_well(tmp_path: Path) -> None:
    report = through_a_door(tmp_path, (-0.38, 0.65), 1.0, GOTO)
    assert report.mission_completed
    assert report.collisions == 0


@pytest.mark.parametrize("item", [DRIVE, GOTO])
def test_a_post_in_the_hollow_behind_the_arm_is_left_behind(item: str, tmp_path: Path) -> None:
    report = through_a_door(tmp_path, (-0.65, 0.38), 1.0, item, POST)
    assert report.mission_completed
    assert report.collisions == 0
