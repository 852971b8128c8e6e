"""Bring-up, last step: the whole stack drives its mission, as a user would start it."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robotctl.workbench.replay.replay import replay_file

STOPPED = "stopped: "
"""So begins what control says of a fault."""


def drive(command: list[str]) -> tuple[int, str]:
    """Run a simulated robot that nobody arms again; return its status and what it said.

    One that stops with a fault is not awaited: it stands to the end of its time.
    """
    said = ""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            said += line
            if STOPPED in line:
                process.terminate()
    return process.returncode, said


def complete(
    bus: str, robot: str, folder: Path, *options: str, mission: str = "patrol"
) -> dict[str, Any]:
    """Drive a mission to its end and return the score."""
    report = folder / "report.json"
    channel = f"simcan:patrol-{os.getpid()}" if bus == "simcan" else bus
    command = [
        *(sys.executable, "-c", "from robotctl.cli.main import main; main()", "sim"),
        *("--mission", mission, "--headless", "--max-seconds", "340", "--seed", "3"),
        *("--robot", robot, "--bus", channel, "--report", str(report)),
        *("--record", str(folder)),
        *("--set", "mavlink.link=[]"),
        *options,
    ]
    status, said = drive(command)
    assert status == 0, said
    assert STOPPED not in said, said
    score: dict[str, Any] = json.loads(report.read_text())
    assert score["mission_completed"] is True
    assert score["collisions"] == 0
    return score


@pytest.mark.timeout(400)
def test_a_robot_that_is_not_told_its_place_finds_it_and_runs_its_errand_round_who_walks_there(
    bus: str, tmp_path: Path
) -> None:
    if bus != "simcan":
        pytest.skip("what a localiser does, the bus does not change: on simcan alone")
    options = ("--localiser", "mcl", "--start", "unknown", "--mapping")
    score = complete(bus, "diff_drive", tmp_path, *options, mission="errand")
    place = score["localisation"]
    assert place["localised_after_s"] < 60.0
    assert place["localised_share"] > 0.9
    assert place["error"]["max_m"] < 0.3
    assert score["map_quality"]["precision"] > 0.9
    assert (tmp_path / "map-0001.yaml").is_file()


@pytest.mark.timeout(400)
@pytest.mark.parametrize("robot", ["diff_drive", "tricycle", "ackermann"])
def test_patrol_is_completed_without_collision(bus: str, robot: str, tmp_path: Path) -> None:
    score = complete(bus, robot, tmp_path)
    assert score["distance_m"] > 15
    assert score["pose_error"]["max_m"] < 0.02 * score["distance_m"]
    assert score["bus"]["errors"] == 0
    assert 0.05 < score["bus"]["load"] < 0.5
    assert score["loop"]["rate_hz"] == 200
    assert score["loop"]["ticks"] > 150 * score["duration_s"]
    replayed = replay_file(tmp_path / "control-0001.rec").result
    assert replayed.difference is None
    assert replayed.agreed > 150 * score["duration_s"]
