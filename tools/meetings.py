"""Meetings in a corridor of 1 m: `tools/meetings.py FOLDER`.

Writes them and `meetings.toml` for `robotctl campaign`. Between two halls the robot meets somebody
who does not react: by turns head-on or from behind and faster, in the middle of the corridor, where
there is no room to pass, or along a wall, where there is, with each drive, with a lidar and with
sonars alone, with and without a niche halfway. The seed draws speed, time and lane.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from case_file import write_cases, write_mission

DRIVES: Final = ("diff_drive", "tricycle", "ackermann")
LIDAR_BEAMS: Final = 360
KINDS: Final = ("head-on", "behind")
LANES_M: Final = {"middle": (-0.08, 0.08), "side": (0.16, 0.2)}
"""Distance of a lane from the corridor's middle [m]; people are discs of 0.22 m."""
HEAD_ON_M_S: Final = (0.5, 1.2)
BEHIND_M_S: Final = (0.8, 1.2)
FAR_M: Final = 100.0
"""Where the walker goes in the end, through walls: who turned round would be met again [m]."""
BEFORE_M: Final = (2.0, 14.0)
"""Way of the walker to where the first hall begins [m]."""
HALL_M: Final = 4.0
CORRIDOR_M: Final = 8.0
HALF_M: Final = 0.5
NICHE_M: Final = (7.4, 8.6, 1.3)
"""From and to along the corridor, and how deep from its middle [m]."""


def world(number: int, kind: str, lane: str, *, niche: bool) -> dict[str, Any]:
    """Return the world of a meeting."""
    rng = np.random.default_rng([number, 51])
    side = float(rng.choice((-1.0, 1.0)))
    y_m = side * float(rng.uniform(*LANES_M[lane]))
    before_m = float(rng.uniform(*BEFORE_M))
    end_m = 2.0 * HALL_M + CORRIDOR_M
    begins, ends = (end_m + before_m, -FAR_M) if kind == "head-on" else (-before_m, FAR_M)
    speed_m_s = float(rng.uniform(*(HEAD_ON_M_S if kind == "head-on" else BEHIND_M_S)))
    a_m, b_m, wide_m = HALL_M, HALL_M + CORRIDOR_M, HALL_M / 2.0
    low = [[a_m, -wide_m], [a_m, -HALF_M]]
    if niche:
        near_m, far_m, deep_m = NICHE_M
        low += [[near_m, -HALF_M], [near_m, -deep_m], [far_m, -deep_m], [far_m, -HALF_M]]
    low += [[b_m, -HALF_M], [b_m, -wide_m]]
    high = [[end_m, -wide_m], [end_m, wide_m], [b_m, wide_m], [b_m, HALF_M], [a_m, HALF_M]]
    outline = [[0.0, -wide_m], *low, *high, [a_m, wide_m], [0.0, wide_m]]
    return {
        "world": {"name": f"meeting_{number:03d}", "bounds": [0.0, -wide_m, end_m, wide_m]},
        "wall": [{"points": outline, "closed": True}],
        "person": [{"points": [[begins, y_m], [ends, y_m]], "speed_m_s": speed_m_s}],
    }


def write(folder: Path, number: int, rounds: int, first: int = 0) -> dict[str, Any]:
    """Write a meeting into a folder; return its case of a campaign there.

    Its seed is `first` and its number.
    """
    kinds = list(itertools.product(KINDS, (True, False), LANES_M, (False, True), DRIVES))
    kind, lidar, lane, niche, drive = kinds[number // rounds]
    name = f"meeting_{number:03d}"
    content = world(first + number, kind, lane, niche=niche)
    start = (HALL_M / 2.0, 0.0, 0.0)
    content["world"]["start"] = dict(zip(("x_m", "y_m", "heading_deg"), start, strict=True))
    (folder / f"{name}_world.toml").write_text(tomlkit.dumps(content), encoding="utf-8")
    goal = (1.5 * HALL_M + CORRIDOR_M, 0.0)
    write_mission(folder / f"{name}.toml", f"{name}_world.toml", start, goal, name)
    lidars: Any = {"beams": LIDAR_BEAMS} if lidar else []
    words = (kind, "lidar" if lidar else "sonar", lane, "niche" if niche else "bare")
    return {
        "name": " ".join(words),
        "robot": drive,
        "mission": f"{name}.toml",
        "options": "--localiser mcl",
        "seed": first + number,
        "criteria": ["mission_completed = true", "collisions = 0", "ran_into = 0"],
        "set": {"simulation": {"lidar": lidars}},
    }


def main() -> None:
    """Write meetings and their campaign."""
    parser = argparse.ArgumentParser(
        prog="tools/meetings.py",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, help="for meetings and the campaign's file")
    add("--rounds", type=int, default=1, help="how many of each kind and drive (%(default)s)")
    add("--first", type=int, default=0, help="seed of the first (%(default)s)")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    count = len(KINDS) * 2 * len(LANES_M) * 2 * len(DRIVES) * options.rounds
    file = options.folder / "meetings.toml"
    rounds, first = options.rounds, options.first
    write_cases(file, (write(options.folder, each, rounds, first) for each in range(count)))
    print(f"robotctl campaign {file}")


if __name__ == "__main__":
    main()
