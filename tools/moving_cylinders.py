"""Fields of moving cylinders: `tools/moving_cylinders.py FOLDER`.

Writes worlds like those of DynaBARN (Nair et al., Benchmarking Metric Ground Navigation in Dynamic
Environments, SSRR 2022), and `cylinders.toml` for `robotctl campaign`: through a square of 20 m,
without a map, where cylinders go to and fro along polynomials through random points and evade
nobody. Each keeps its speed and is a person to our simulator, 0.22 m in radius; there speeds change
and radii are 0.5 m. By turns there are few slow, more, and many fast ones, in numbers of our own.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit
from numpy.typing import NDArray

from case_file import write_cases, write_mission

HALF_M: Final = 10.0
ENDS_M: Final = 9.0
"""Distance of start and goal from the middle [m]."""
AWAY_M: Final = 3.0
"""Least distance of a cylinder from the robot at the start [m]."""
CORNERS: Final = 40
LEVELS: Final[dict[str, tuple[tuple[int, int], tuple[float, float], tuple[int, int]]]] = {
    "easy": ((2, 6), (0.5, 0.8), (1, 2)),
    "medium": ((6, 11), (0.5, 1.2), (1, 3)),
    "hard": ((11, 16), (0.8, 2.0), (2, 4)),
}
"""Numbers of cylinders, their speeds [m/s], and orders of the polynomials."""


def way(rng: np.random.Generator, order: int) -> NDArray[np.float64]:
    """Return the longest part of a random polynomial in the square, (n, 2) [m]."""
    while True:
        xs, ys = rng.uniform(-HALF_M, HALF_M, (2, order + 1))
        x = np.linspace(-HALF_M, HALF_M, 10 * CORNERS)
        y = np.polyval(np.polyfit(xs, ys, order), x)
        inside = np.concatenate([[0], (np.abs(y) <= HALF_M).astype(int), [0]])
        begins, ends = np.flatnonzero(np.diff(inside) > 0), np.flatnonzero(np.diff(inside) < 0)
        if not len(begins):
            continue
        longest = int(np.argmax(ends - begins))
        points = np.column_stack([x, y])[begins[longest] : ends[longest]]
        points = points[:: max(1, len(points) // CORNERS)]
        if rng.random() < 0.5:
            points = points[::-1]
        if len(points) > order + 1 and np.hypot(points[0, 0], points[0, 1] + ENDS_M) > AWAY_M:
            return points


def world(number: int, level: str) -> dict[str, Any]:
    """Return a world."""
    rng = np.random.default_rng([number, 53])
    (least, most), speeds_m_s, (lowest, highest) = LEVELS[level]
    people = []
    for _ in range(int(rng.integers(least, most))):
        points = way(rng, int(rng.integers(lowest, highest + 1)))
        there_and_back = np.vstack([points, points[-2:0:-1]]).round(3)
        speed_m_s = round(float(rng.uniform(*speeds_m_s)), 2)
        people.append({"points": there_and_back.tolist(), "speed_m_s": speed_m_s})
    edge_m = HALF_M + 2.0
    corners = [[-edge_m, -edge_m], [edge_m, -edge_m], [edge_m, edge_m], [-edge_m, edge_m]]
    return {
        "world": {"name": f"cylinders_{number:03d}", "bounds": [*corners[0], *corners[2]]},
        "wall": [{"points": corners, "closed": True}],
        "person": people,
    }


def write(folder: Path, number: int, robot: str) -> dict[str, Any]:
    """Write a world and its mission into a folder; return its case of a campaign there."""
    level = [*LEVELS][number % len(LEVELS)]
    name = f"cylinders_{number:03d}"
    content = world(number, level)
    start = (0.0, -ENDS_M, 90.0)
    content["world"]["start"] = dict(zip(("x_m", "y_m", "heading_deg"), start, strict=True))
    (folder / f"{name}_world.toml").write_text(tomlkit.dumps(content), encoding="utf-8")
    write_mission(folder / f"{name}.toml", f"{name}_world.toml", start, (0.0, ENDS_M), name)
    return {
        "name": level,
        "robot": robot,
        "mission": f"{name}.toml",
        "options": "--localiser none",
        "seed": number,
        "criteria": ["arrived = true", "collisions = 0"],
    }


def main() -> None:
    """Write worlds and their campaign."""
    parser = argparse.ArgumentParser(
        prog="tools/moving_cylinders.py",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, help="for worlds, missions and the campaign's file")
    add("--count", type=int, default=60, help="how many worlds (%(default)s)")
    add("--robot", default="jackal", help="robot file or name (%(default)s)")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    file = options.folder / "cylinders.toml"
    write_cases(file, (write(options.folder, i, options.robot) for i in range(options.count)))
    print(f"robotctl campaign {file}")


if __name__ == "__main__":
    main()
