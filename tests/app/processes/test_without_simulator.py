"""A robot runs without the simulator: no process of it imports `firmware_sim`."""

import subprocess
import sys

from robotctl.app.supervision.stack import CAMERA_ROLE, LIDAR_ROLE, ROLES

PROCESSES = [role.module for role in (*ROLES, CAMERA_ROLE, LIDAR_ROLE)]
COMMANDS = [f"robotctl.cli.{name}" for name in ("main", "run", "doctor", "install")]
ON_A_ROBOT = [*COMMANDS, "robotctl.app.supervision.stack", *PROCESSES]
WITHOUT = "import sys; sys.modules['firmware_sim'] = None; "
"""An import of the simulator, now or later, raises ImportError."""


def status(code: str) -> int:
    return subprocess.run([sys.executable, "-c", code], timeout=120, check=False).returncode


def test_what_runs_on_a_robot_needs_no_simulator() -> None:
    assert status(f"{WITHOUT}import {', '.join(ON_A_ROBOT)}") == 0


def test_a_robot_finds_itself_in_a_world_without_the_simulator() -> None:
    code = (
        "from pathlib import Path; "
        "from robotctl.app.localisation.estimators import make_estimators; "
        "from robotctl.maps.localisation_map import load_localisation_map; "
        "assert load_localisation_map('flat', Path()).walls is not None"
    )
    assert status(WITHOUT + code) == 0


def test_the_simulator_does_need_itself() -> None:
    assert status(f"{WITHOUT}import robotctl.app.simulation.room") != 0
