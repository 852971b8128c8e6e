"""The commands of README, tutorial and command page run as they stand, with their files."""

import gzip
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from example_log import LOG, lines
from robotctl.logs.formats.recorded_log import read_recording

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
TUTORIAL = ROOT / "docs" / "tutorial.md"
COMMANDS = ROOT / "docs" / "commands.md"
LIVE = "robotctl sim --robot rover/rover --mission rover/rounds\n"
"""The one command of the tutorial that takes half a minute whatever the computer."""
BY_HAND = ("make setup\n", LIVE)
DOCTOR = "robotctl doctor --robot rover/rover"
"""It measures the delays of this computer for five seconds, here for less."""


def blocks(page: Path) -> list[str]:
    """Return what stands in the blocks of commands of a page."""
    return re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.M)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a folder that has what a checkout has for these commands."""
    (tmp_path / ".venv").symlink_to(sys.prefix)
    for name in ("configs", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def run(script: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run commands as they stand, up to the first that fails."""
    return subprocess.run(
        ["bash", "-euc", script], cwd=folder, env=os.environ | {"COLUMNS": "200"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_the_tutorial_leads_to_a_driven_mission_a_log_and_a_plot(checkout: Path) -> None:
    script = "".join(blocks(TUTORIAL))
    for command in BY_HAND:
        assert command in script
        script = script.replace(command, "")
    assert DOCTOR in script
    done = run(script.replace(DOCTOR, f"{DOCTOR} --seconds 0.2"), checkout)
    assert done.returncode == 0, done.stderr
    assert 'unknown key; did you mean "track_width_m"?' in done.stderr
    rover = checkout / "rover"
    report = json.loads((rover / "rounds.json").read_text())
    assert report["mission_completed"]
    assert (report["mission"], report["world"]) == ("rounds", "yard")
    assert (rover / "speed.png").read_bytes().startswith(b"\x89PNG")
    assert (rover / "tables" / "control.csv").exists()
    assert "all outputs the same bit for bit" in done.stdout
    assert "[control.left]" in (rover / "gains.toml").read_text()


def test_the_documents_localise_on_a_log_that_comes_along(checkout: Path) -> None:
    offline = [
        line
        for block in blocks(COMMANDS)
        for line in block.splitlines()
        if re.match(r"\S*robotctl (map|localise) ", line)
    ]
    assert len(offline) >= 2
    done = run("\n".join(offline), checkout)
    assert done.returncode == 0, done.stderr
    error_m = re.search(r"position error (\S+) m rms", done.stdout)
    assert error_m is not None
    assert float(error_m[1]) < 0.05


FILE = re.compile(r"[\w./-]+\.(?:gz|toml|yaml|pgm|log|rec|dbc|json|tum|csv|png|mcap|py)\b")
MAKES = re.compile(r"(?:--out|--report|--record|--csv|-f|>) *([\w./-]+)")


@pytest.mark.parametrize("page", [README, TUTORIAL, COMMANDS], ids=lambda page: page.stem)
def test_no_command_needs_a_file_that_is_not_there(page: Path) -> None:
    made: set[str] = set()
    for line in "".join(blocks(page)).splitlines():
        command = line.partition(" #")[0]
        made |= set(MAKES.findall(command))
        made |= {f"{prefix}.yaml" for prefix in MAKES.findall(command)}
        if command.startswith("cp "):
            made.add(command.split()[-1])
        for name in FILE.findall(command):
            comes_along = (ROOT / name).exists() or (TUTORIAL.parent / name).exists()
            assert comes_along or any(name.startswith(each) for each in made), line


def test_the_example_log_is_a_carmen_log_of_the_tool(tmp_path: Path) -> None:
    recording = read_recording(LOG)
    assert len(recording.scans) == 166
    assert all(scan.reference is not None for scan in recording.scans)
    heading, parameter, first, *_ = gzip.decompress(LOG.read_bytes()).decode().splitlines()
    written = list(lines(recording))
    assert written[:2] == [heading, parameter]
    assert written[2].split()[:2] == first.split()[:2] == ["FLASER", "181"]
