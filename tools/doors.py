"""Doors that hardly leave room: `tools/doors.py FOLDER`.

Writes them and `doors.toml` for `robotctl campaign`. The robot drives from one room of 4 m to
another, whose map it knows, through a door that is by so much wider than its body, with cells of
its map of so much, with a lidar or with sonars alone. The seed draws where wall, door, start and
goal are, and how thick the wall is.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from case_file import write_cases, write_mission
from robotctl.config.robot_file import find_file, load_robot

DRIVES: Final = ("diff_drive", "tricycle", "ackermann")
LIDAR_BEAMS: Final = 360
KINDS: Final = (
    ("lidar", 0.15, 0.05),
    ("lidar", 0.10, 0.05),
    ("lidar", 0.08, 0.05),
    ("lidar", 0.08, 0.02),
    ("lidar", 0.05, 0.02),
    ("lidar", 0.05, 0.01),
    ("sonar", 0.20, 0.05),
    ("sonar", 0.15, 0.05),
    ("sonar", 0.10, 0.05),
)
"""What it sees by, room beside its body and side of its map's cells [m]."""
WITHOUT_LIDAR: Final = DRIVES[1:]
ROOM_M: Final = 4.0
WALL_X_M: Final = (3.5, 4.0)
THICK_M: Final = (0.06, 0.15)
DOOR_Y_M: Final = (-1.0, 1.0)
ENDS_Y_M: Final = (-1.2, 1.2)


def write(folder: Path, number: int, kind: tuple[str, float, float], drive: str) -> dict[str, Any]:
    """Write a door into a folder; return its case of a campaign there."""
    sight, extra_m, cell_m = kind
    rng = np.random.default_rng([number, 52])
    wall_m, thick_m = float(rng.uniform(*WALL_X_M)), float(rng.uniform(*THICK_M))
    door_m, start_m, goal_m = (
        round(float(rng.uniform(*each)), 3) for each in (DOOR_Y_M, ENDS_Y_M, ENDS_Y_M)
    )
    footprint = load_robot(find_file(drive)).footprint
    half_m = 0.5 * (footprint.left_m + footprint.right_m + extra_m)
    wide_m, end_m = 0.5 * ROOM_M, wall_m + thick_m + ROOM_M
    a_m, b_m = wall_m, wall_m + thick_m
    low_m, high_m = door_m - half_m, door_m + half_m
    outline = [
        [0.0, -wide_m], [a_m, -wide_m], [a_m, low_m], [b_m, low_m], [b_m, -wide_m],
        [end_m, -wide_m], [end_m, wide_m], [b_m, wide_m], [b_m, high_m], [a_m, high_m],
        [a_m, wide_m], [0.0, wide_m],
    ]  # fmt: skip
    name = f"door_{number:03d}"
    start = (0.9, start_m, 0.0)
    content = {
        "world": {
            "name": name,
            "bounds": [0.0, -wide_m, end_m, wide_m],
            "start": dict(zip(("x_m", "y_m", "heading_deg"), start, strict=True)),
        },
        "wall": [{"points": outline, "closed": True}],
    }
    (folder / f"{name}_world.toml").write_text(tomlkit.dumps(content), encoding="utf-8")
    goal = (end_m - 0.9, goal_m)
    write_mission(folder / f"{name}.toml", f"{name}_world.toml", start, goal, name)
    settings: dict[str, Any] = {"navigation": {"map": {"cell_m": cell_m}}}
    if sight == "lidar":
        settings["simulation"] = {"lidar": {"beams": LIDAR_BEAMS}}
    return {
        "name": f"{sight}, +{extra_m:.2f} m, cells of {cell_m:.2f} m",
        "robot": drive,
        "mission": f"{name}.toml",
        "options": "--localiser mcl --start known",
        "seed": number,
        "set": settings,
    }


def main() -> None:
    """Write doors and their campaign."""
    parser = argparse.ArgumentParser(
        prog="tools/doors.py", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    add = parser.add_argument
    add("folder", type=Path, help="for doors and the campaign's file")
    add("--rounds", type=int, default=4, help="how many of each kind and drive (%(default)s)")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    drives = {"lidar": DRIVES, "sonar": WITHOUT_LIDAR}
    each = [(kind, drive) for kind in KINDS for drive in drives[kind[0]]] * options.rounds
    file = options.folder / "doors.toml"
    write_cases(file, (write(options.folder, i, *case) for i, case in enumerate(each)))
    print(f"robotctl campaign {file}")


if __name__ == "__main__":
    main()
