"""Missions under the virtual clock, for several tests."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from robotctl.app.scoring.score import Report
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file

PATROL = find_file("patrol", "missions")


def drive(robot: str = "diff_drive", **options: object) -> Report:
    return run_lockstep(SimOptions(find_file(robot), PATROL, **options))


def fingerprint(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def without_computing_times(report: Report) -> dict:
    plain = msgspec.json.decode(report.json())
    del plain["real_time_factor"], plain["loop"]["step_us"]
    return plain
