"""Find out how the sonars of a recorded ring sit, by the map that they agree on, and draw it.

The recording has eight ranges and a pose in each row, units and mounting undocumented. A guess of
both is scored by how well each sonar's echoes are foretold by the map of the *other* sonars at the
same poses: the log-likelihood of the cells along its axis, free up to the echo and occupied there,
above that of an unknown map, on average of the cells that the others have seen. A wrong guess puts
echoes where other sonars look through.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from robotctl.estimation.grid.config import OccupancyGridConfig
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount

NO_ECHO = 5110.0
"""What the sonars read where they hear nothing [units of the file]."""
MOVED_M = 0.02
"""Rows nearer to the one before are left out: a robot that stands measures the same again."""
ARC_M = 0.2
"""An echo counts as foretold by the most occupied cell so near to it along the axis."""
CONFIG = OccupancyGridConfig(
    resolution_m=0.1, sonar_width_deg=20.0, sonar_band_m=0.1, sonar_range_m=5.0
)

FRONT = (90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0)
EVEN_FRONT = tuple(float(angle) for angle in np.linspace(90.0, -90.0, 8))


@dataclass(frozen=True)
class Ring:
    """Rows of a recording: ranges (n, 8) [m], inf without echo, and poses (n, 3) [m, m, rad]."""

    ranges_m: NDArray[np.float64]
    poses: NDArray[np.float64]


@dataclass(frozen=True)
class Guess:
    """Directions of the sonars [deg], and what the file's units are worth."""

    name: str
    headings_deg: tuple[float, ...]
    range_unit_m: float = 0.001
    angle_unit_deg: float = 0.1
    radius_m: float = 0.0

    def mounts(self) -> list[SonarMount]:
        """Return the mountings, on a circle about `base`."""
        angles = np.radians(self.headings_deg)
        places = self.radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return [
            SonarMount(f"sonar {k + 1}", float(x), float(y), heading)
            for k, ((x, y), heading) in enumerate(zip(places, self.headings_deg, strict=True))
        ]


def read_ring(folder: Path, guess: Guess) -> Ring:
    """Read both files in the units of a guess, the poses in millimetres."""
    measured = np.loadtxt(folder / "ring8_measurement.txt")
    posed = np.loadtxt(folder / "ring8_poses.txt")
    if not np.array_equal(measured[:, 0], posed[:, 0]):
        raise SystemExit(f"{folder}: the times of the two files differ")
    poses = posed[:, 1:] * (0.001, 0.001, np.radians(guess.angle_unit_deg))
    moved = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=np.nan).T) >= MOVED_M
    ranges = np.where(measured[:, 1:] < NO_ECHO, measured[:, 1:] * guess.range_unit_m, np.inf)
    return Ring(ranges[moved], poses[moved])


def map_of(ring: Ring, mounts: Sequence[SonarMount], without: int | None = None) -> OccupancyGrid:
    """Return the grid of all echoes, or of all but one sonar's.

    Readings without an echo are left out: off a smooth wall at an angle, sound does not come back.
    """
    grid = OccupancyGrid(CONFIG)
    for pose, ranges_m in zip(ring.poses, ring.ranges_m, strict=True):
        for k, range_m in enumerate(ranges_m):
            if k != without and np.isfinite(range_m):
                grid.update_sonar(SE2(*pose), mounts[k], float(range_m))
    return grid


def foretold(grid: OccupancyGrid, ring: Ring, mount: SonarMount, k: int) -> tuple[float, int]:
    """Return how well a grid foretells a sonar's echoes: sum of log-likelihoods, and how many.

    Each cell along the axis that the grid knows counts, free up to the echo; at the echo, one.
    """
    odds, shown, side_m = grid.log_odds(), grid.to_map(), CONFIG.resolution_m
    total, count = 0.0, 0
    for pose, range_m in zip(ring.poses, ring.ranges_m[:, k], strict=True):
        if not np.isfinite(range_m):
            continue
        sensor = SE2(*pose) @ SE2(mount.x_m, mount.y_m, mount.heading_rad)
        away = np.arange(side_m, range_m + ARC_M, side_m)
        direction = np.array([np.cos(sensor.theta_rad), np.sin(sensor.theta_rad)])
        cells = shown.cell_of((sensor.x_m, sensor.y_m) + away[:, None] * direction)
        inside = np.all((cells >= 0) & (cells < odds.shape), axis=1)
        along = odds[tuple(cells[inside].T)]
        before = along[(away[inside] < range_m - ARC_M) & (along != 0.0)]
        at = along[(away[inside] >= range_m - ARC_M) & (along != 0.0)]
        evidence = [*-before, *at[at == at.max(initial=-np.inf)][:1]]  # log odds of what was seen
        total += float(np.sum(np.log(2.0) - np.logaddexp(0.0, -np.array(evidence))))
        count += len(evidence)
    return total, count


def score(folder: Path, guess: Guess) -> float:
    """Return what the other sonars foretell, on average of the cells looked at [nat]."""
    ring, mounts = read_ring(folder, guess), guess.mounts()
    parts = [
        foretold(map_of(ring, mounts, without=k), ring, mounts[k], k) for k in range(len(mounts))
    ]
    return sum(part[0] for part in parts) / sum(part[1] for part in parts)


def guesses() -> list[Guess]:
    """Return the mountings to try: full rings and half rings, both ways round."""
    found = []
    for sense, turning in ((1, "left"), (-1, "right")):
        for first in np.arange(0.0, 360.0, 22.5):
            headings = tuple(float(first + sense * 45.0 * k) for k in range(8))
            found.append(Guess(f"full ring from {first:g}, to the {turning}", headings))
        side = "left" if sense > 0 else "right"
        found.append(Guess(f"front, 90 50 30 10, 1 on the {side}", tuple(sense * a for a in FRONT)))
        found.append(
            Guess(
                f"front, evenly 25.7 apart, 1 on the {side}", tuple(sense * a for a in EVEN_FRONT)
            )
        )
    return found


def units(best: Guess) -> list[Guess]:
    """Return a mounting in other units, and on a circle."""
    found = [
        replace(best, name=f"a range of 1 is {unit:g} mm", range_unit_m=0.001 * unit)
        for unit in (0.8, 0.9, 1.0, 1.1, 1.25)
    ]
    found += [
        replace(best, name=f"a heading of 1 is {unit:g} deg", angle_unit_deg=unit)
        for unit in (0.09, 0.095, 0.1, 0.105, 0.11)
    ]
    found += [
        replace(best, name=f"sonars {radius_m:g} m from the middle", radius_m=radius_m)
        for radius_m in (0.1, 0.2)
    ]
    return found


def ranked(folder: Path, tried: Sequence[Guess]) -> list[tuple[float, Guess]]:
    """Return guesses with their scores, the best first."""
    return sorted(((score(folder, guess), guess) for guess in tried), key=lambda each: -each[0])


def draw(folder: Path, guess: Guess, target: Path) -> None:
    """Save a picture of the map and the path."""
    ring = read_ring(folder, guess)
    grid = map_of(ring, guess.mounts())
    odds, origin, side_m = grid.log_odds(), grid.to_map().origin, CONFIG.resolution_m
    rows, columns = odds.shape
    extent = (
        origin.x_m,
        origin.x_m + columns * side_m,
        origin.y_m,
        origin.y_m + rows * side_m,
    )
    figure = Figure(figsize=(8.0, 5.5), dpi=110, layout="constrained")
    axes = figure.subplots()
    shown = axes.imshow(
        1.0 / (1.0 + np.exp(-odds)), "gray_r", origin="lower", extent=extent, vmin=0.0, vmax=1.0
    )
    axes.plot(ring.poses[:, 0], ring.poses[:, 1], color="tab:orange", label="robot")
    axes.set(xlabel="x [m]", ylabel="y [m]", title=f"Eight sonars: {guess.name}")
    axes.legend(loc="lower left")
    figure.colorbar(shown, label="probability of being occupied", shrink=0.7)
    figure.savefig(target)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="holds ring8_measurement.txt, ring8_poses.txt")
    parser.add_argument("--plot", type=Path, help="draw the map: .png, .svg or .pdf")
    options = parser.parse_args()
    best = ranked(options.folder, guesses())
    for value, guess in [*best[:5], best[-1]]:
        print(f"{value:7.3f} nat a cell  {guess.name}")
    print(f"of {len(best)} mountings, the first five and the last; the first in other units:")
    for guess in units(best[0][1]):
        print(f"{score(options.folder, guess):7.3f} nat a cell  {guess.name}")
    if options.plot is not None:
        draw(options.folder, best[0][1], options.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
