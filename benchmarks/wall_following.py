"""Following a wall at 0.4 m past a door, on both sides: distance of the true robot from the wall.

Along 8 m of wall with a door of 0.9 m in its middle. The first metre and half a metre about the
door do not count. Corners are not followed: where the wall ends, the item ends.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file

DISTANCE_M = 0.4
DOOR = (3.6, 4.5)
WORLD = f"""[world]
name = "door"
start = {{ x_m = 0.5, y_m = 0.4, heading_deg = 0.0 }}
[[wall]]
points = [[-1.0, -2.0], [9.0, -2.0], [9.0, 4.0], [-1.0, 4.0]]
closed = true
[[wall]]
points = [[0.0, 0.0], [{DOOR[0]}, 0.0]]
thickness_m = 0.1
[[wall]]
points = [[{DOOR[1]}, 0.0], [8.0, 0.0]]
thickness_m = 0.1
"""
FACE_M = 0.05
"""Of the wall, to the side of the robot."""
MISSION = """name = "wall"
world = "door.toml"
start = {{ x_m = {x_m}, y_m = {y_m}, heading_deg = {heading_deg} }}
[[item]]
kind = "follow_wall"
side = "{side}"
distance_m = {distance_m}
until = {{ length_m = 7.0 }}
"""
ROBOTS = ("diff_drive", "tricycle", "ackermann")
OFFSETS_M = (0.0, 0.1)
"""Beyond the wanted distance at the start."""


def run(_rounds: int, _seconds: float) -> None:
    """Follow it with each robot, on both sides."""
    rows = []
    for robot in ROBOTS:
        for side in ("right", "left"):
            errors_m = np.concatenate([_errors_m(robot, side, each) for each in OFFSETS_M])
            rms_m = math.sqrt(float((errors_m**2).mean()))
            most_m = float(np.abs(errors_m).max())
            rows.append((robot, side, f"{100 * rms_m:.1f}", f"{100 * most_m:.1f}"))
    heads = ("robot", "wall", "rms, cm", "greatest, cm")
    machine.table("Following a wall at 0.4 m past a door, straights", heads, rows)


def _errors_m(robot: str, side: str, offset_m: float) -> np.ndarray:
    """Return the errors of the distance on the straights; all nan where the robot gave up."""
    x_m, heading_deg = (0.5, 0.0) if side == "right" else (7.5, 180.0)
    y_m = FACE_M + DISTANCE_M + offset_m
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "door.toml").write_text(WORLD, encoding="utf-8")
        mission = Path(folder) / "wall.toml"
        text = MISSION.format(
            x_m=x_m, y_m=y_m, heading_deg=heading_deg, side=side, distance_m=DISTANCE_M
        )
        mission.write_text(text, encoding="utf-8")
        run = LockstepRun(SimOptions(find_file(robot), mission, max_seconds=60.0))
        errors, done = [], False
        for _, navigation in run.steps():
            x_m, y_m, _ = run.stack.simulation.pose()
            done = navigation.mission_completed
            near_door = DOOR[0] - 0.5 <= x_m <= DOOR[1] + 0.5
            if abs(x_m - (0.5 if side == "right" else 7.5)) >= 1.0 and not near_door:
                errors.append(y_m - FACE_M - DISTANCE_M)
    return np.array(errors) if done else np.full(1, math.nan)
