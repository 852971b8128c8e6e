"""The campaign of `make campaign`: `tools/own_campaign.py FOLDER`.

Writes `own.toml` for `robotctl campaign` into FOLDER: missions drawn among people and clutter, the
faults after which a robot must stop and the scenarios it can live with, and a sample of BARN's
courses, if $ROBOTCTL_DATA has them. With `--score RESULTS` BARN's score is printed.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import tomlkit

import barn
import missions
from case_file import write_cases
from hil_tests.fault_rows import ROWS, Row

ROOT = Path(__file__).resolve().parents[1]

MISSIONS = 100
EVERY_COURSE = 5
"""Of BARN's courses, one of so many."""
AT_S = 8.0
"""When a fault begins [s]: the robot drives its patrol."""
STOPS = ["mission_completed = false", "collisions = 0", "unsafe_motions = 0"]


def fault_cases(folder: Path) -> list[dict[str, Any]]:
    """Return a case for each fault, and for each robot with the scenario to live with."""
    robots = ("diff_drive", "tricycle", "ackermann")
    lived = [
        {"name": "faults to live with", "robot": robot, "mission": "patrol", "faults": "bus"}
        for robot in robots
    ]
    return [*(_case(number, row, folder) for number, row in enumerate(ROWS)), *lived]


def _case(number: int, row: Row, folder: Path) -> dict[str, Any]:
    """Write the scenario of a fault; return its case."""
    kind, *words = row.fault.split()
    fault: dict[str, Any] = {"kind": kind, "at": AT_S}
    fault |= {key: _value(text) for key, text in (each.split("=") for each in words)}
    name = f"fault_{number:02d}_{kind}.toml"
    (folder / name).write_text(tomlkit.dumps({"fault": [fault]}), encoding="utf-8")
    return {
        "name": "faults that must stop it",
        "mission": "patrol",
        "faults": name,
        "criteria": STOPS,
    }


def _value(text: str) -> Any:
    """Return a value of a fault, as a scenario has it."""
    for kind in (lambda: int(text, 0), lambda: float(text)):
        try:
            return kind()
        except ValueError:
            continue
    return text


def barn_file() -> Path:
    """Return where BARN's courses are, if they are."""
    data = os.environ.get("ROBOTCTL_DATA", ROOT.parent / "shared" / "data")
    return Path(data) / "barn" / "worlds.json.gz"


def main() -> None:
    """Write the campaign, or print BARN's score."""
    parser = argparse.ArgumentParser(
        prog="tools/own_campaign.py",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("folder", type=Path, help="for the campaign, or its results with --score")
    parser.add_argument("--score", action="store_true", help="print BARN's score")
    options = parser.parse_args()
    folder, source = options.folder, barn_file()
    if not source.exists():
        print(f"campaign: BARN not run: no {source}; set ROBOTCTL_DATA")
    challenge, courses = barn.read(source) if source.exists() else (None, [])
    if options.score:
        if courses:
            print(barn.score(folder, courses))
        return
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor() as pool:
        drawn = pool.map(missions.draw, range(MISSIONS))
        cases = [*(each.write(folder) for each in drawn), *fault_cases(folder)]
    if challenge is not None:
        cases += [barn.case(each, challenge, folder) for each in courses[::EVERY_COURSE]]
    write_cases(folder / "own.toml", cases)


if __name__ == "__main__":
    main()
