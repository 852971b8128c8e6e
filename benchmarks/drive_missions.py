"""Missions on each make of drive, in lockstep with seed 3: bought drives beside our own.

The errand through the lived-in flat, whose start the robot does not know, and a drive along the
office's corridor into a room; by MCL. `diff_drive`, `ackermann` and `jackal` have our own motor
controller: the first two with sonars, the last with a lidar.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Final

from benchmarks import machine
from robotctl.app.scoring.score import Report
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.room import goal_mission
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.maps.world import find_world

OWN: Final = ("diff_drive", "ackermann", "jackal")
BOUGHT: Final = (
    "odrive", "vesc_car", "moteus", "zlac8015d", "roboteq", "cia402", "skid_steer", "mecanum",
)  # fmt: skip
SEED: Final = 3
GOAL: Final = (20.5, 11.5)
"""A room of the office, from its west end [m]."""
MCL: Final = 'localisation.method="mcl"'
UNKNOWN: Final = 'localisation.start="unknown"'
_HEADS: Final = (
    "robot", "completed", "s", "m", "collisions", "pose, m rms", "greatest, m", "heading, deg rms",
    "odometry alone, m rms",
)  # fmt: skip


def run(_rounds: int, _seconds: float) -> None:
    """Drive both missions on all robots."""
    for name, drive in (("errand", errand), ("office", office)):
        rows = [_row(robot, drive(robot)) for robot in (*OWN, *BOUGHT)]
        machine.table(f"Missions on drives: {name}, seed {SEED}", _HEADS, rows)


def errand(robot: str) -> Report:
    """Drive the errand."""
    mission = find_file("errand", "missions")
    return run_lockstep(
        SimOptions(find_file(robot), mission, seed=SEED, localisation=(MCL, UNKNOWN))
    )


def office(robot: str) -> Report:
    """Drive from the office's corridor into a room."""
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "goal.toml"
        mission.write_text(goal_mission(find_world("office"), (), GOAL), encoding="utf-8")
        return run_lockstep(SimOptions(find_file(robot), mission, seed=SEED, localisation=(MCL,)))


def _row(robot: str, report: Report) -> tuple[str, ...]:
    error, localisation = report.pose_error, report.localisation
    alone = "-" if localisation is None else f"{localisation.odometry_rmse_m:.3f}"
    return (
        robot,
        "yes" if report.mission_completed else report.message,
        f"{report.duration_s:.0f}",
        f"{report.distance_m:.1f}",
        str(report.collisions),
        f"{error.rmse_m:.3f}",
        f"{error.max_m:.3f}",
        f"{math.degrees(error.heading_rmse_rad):.2f}",
        alone,
    )
