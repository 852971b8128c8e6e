"""A binary mask beside a robot's file: the robot tells when it gets into its area, and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.planning.supervision import DriveSupervision

MASK = """
[[navigation.pilot.mask]]
file = "camera_off.yaml"
kind = "binary"
"""
FROM_M, TO_M = 1.5, 2.5
"""Area along x."""


def test_the_state_says_where_the_robot_is(tmp_path: Path) -> None:
    robot, mission = tmp_path / "robot.toml", tmp_path / "mission.toml"
    robot.write_text(find_file("diff_drive").read_text() + MASK)
    pixels = np.full((50, 80), 254, np.uint8)  # 5 m by 8 m, free
    pixels[:, round(10 * FROM_M) : round(10 * TO_M)] = 0
    Image.fromarray(pixels).save(tmp_path / "camera_off.png")
    (tmp_path / "camera_off.yaml").write_text(
        "image: camera_off.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    mission.write_text(
        'name = "through"\nworld = "flat"\nstart = { x_m = 1.0, y_m = 1.0 }\n'
        '[[item]]\nkind = "goto"\nx_m = 3.2\ny_m = 1.0\n'
    )
    options = SimOptions(
        robot, mission, seed=3, max_seconds=60.0, localisation=('localisation.method="mcl"',)
    )
    run = LockstepRun(options)
    told: list[tuple[float, bool]] = []

    def tell(_: Any, navigation: Any) -> None:
        told.append((run.stack.simulation.pose()[0], navigation.areas == ("camera_off",)))

    report = run.run(tell)
    assert report.mission_completed
    x_m, inside = np.array([each for each, _ in told]), np.array([each for _, each in told])
    assert inside.any()
    sure = np.abs(x_m - FROM_M) > 0.1
    sure &= np.abs(x_m - TO_M) > 0.1
    assert (inside == ((x_m > FROM_M) & (x_m < TO_M)))[sure].all()


def test_each_area_is_told_once_on_the_way_in_and_out() -> None:
    supervision = DriveSupervision()
    for areas in ((), ("a",), ("a",), ("a", "b"), ("b",), ("c",), ("c",)):
        supervision.note_areas(areas)
    assert supervision.take_notices() == ["in a", "in b", "out of a", "in c", "out of b"]
