"""Signatures of places on a real ring of 24 sonars: the UCI set of a robot that follows walls.

The robot drives round and round a room along its walls (Freire, Barreto, Veloso, Varela 2009); each
row has 24 ranges, 15 degrees apart, and what the robot was doing, but no pose. So a row is a
signature by itself. How far the robot has turned shows in the shift that fits best, against its
label; and a place of one round shows in another as the phase of the round.
"""

from __future__ import annotations

import argparse
import gzip
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.places import Place, Visit
from robotctl.estimation.places.signatures import Signature, SignatureConfig, SignatureIndex
from robotctl.model.geometry.se2 import SE2

FILE = "scitos_24_sonars.data.gz"
CONFIG = SignatureConfig(bearings=24, max_range_m=5.0)
RATE_HZ = 9.0
LAGS = (1, 3, 9, 18, 45, 90, 180)
PLACES, FIRST, EVERY = 12, 300, 4
"""Places learnt in one round, the row of the first, and which rows of other rounds are tried."""
NEAR = 1 / 6
"""Recognised so near in phase, as a share of a round, is right: rounds differ in length."""


@dataclass(frozen=True)
class Ring:
    """Signatures of the rows, (n,), and their labels."""

    signatures: tuple[Signature, ...]
    labels: NDArray[np.str_]


def read_ring(folder: Path) -> Ring:
    """Read the recording; the greatest reading, 5 m, is no echo."""
    with gzip.open(folder / FILE, "rt", encoding="ascii") as file:
        rows = [line.strip().split(",") for line in file][1:]
    ranges = np.array([[float(word) for word in row[:-1]] for row in rows])
    silent = ranges >= CONFIG.max_range_m
    depths = np.where(silent, np.nan, ranges)
    found = map(Signature, depths, silent.astype(float))
    return Ring(tuple(found), np.array([row[-1] for row in rows]))


def turned(ring: Ring, label: str, lag: int) -> NDArray[np.float64]:
    """Return for each row whose label lasts for `lag` rows how the ring differs after them, (k, 3).

    Unshifted; at the best shift; and that shift, in sonars to the left.
    """
    same = ring.labels == label
    lasting = [i for i in range(len(same) - lag) if same[i : i + lag + 1].all()]
    found = []
    for i in lasting:
        one = SignatureIndex([ring.signatures[i]], CONFIG)
        (curve,) = one.compare(ring.signatures[i + lag]).differences()
        shift = (int(curve.argmin()) + 12) % 24 - 12
        found.append((curve[0], curve.min(), shift))
    return np.array(found)


def likeness(ring: Ring, every: int) -> NDArray[np.float64]:
    """Return the difference between each pair of every so many rows."""
    return SignatureIndex(ring.signatures[::every], CONFIG).each_other()


def round_rows(ring: Ring, every: int = 12) -> int:
    """Return the length of a round in rows: the lag, from 500 on, at which rows are most alike."""
    differences = likeness(ring, every)
    lags = range(500 // every, 1500 // every)
    means = [np.diagonal(differences, lag).mean() for lag in lags]
    return every * lags[int(np.argmin(means))]


@dataclass(frozen=True)
class Revisits:
    """What became of the rows of other rounds.

    Attributes
    ----------
    tried
        How many rows.
    places
        Which place each accepted row was taken for, (k,).
    phase_off
        How far in phase from that place, (k,), -0.5 to 0.5 of a round.
    threshold
        Of the book.
    """

    tried: int
    places: NDArray[np.int64]
    phase_off: NDArray[np.float64]
    threshold: float

    @property
    def right(self) -> float:
        """Share of the accepted rows that are near in phase."""
        return float(np.mean(np.abs(self.phase_off) < NEAR))


def revisits(ring: Ring, rows: int) -> Revisits:
    """Learn places in one round of so many rows, two rows each, and try the other rounds."""
    learnt = [FIRST + round(k * rows / PLACES) for k in range(PLACES)]
    visits = [
        [Visit(SE2(), ring.signatures[each]) for each in (row, row + 2)] for row in learnt
    ]  # of a piece of the way, since the robot drives
    places = [Place(str(k), in_world=False, visits=tuple(two)) for k, two in enumerate(visits)]
    book = PlaceBook(places, CONFIG)
    others = [i for i in range(0, len(ring.signatures), EVERY) if not -60 <= i - FIRST < rows + 60]
    found = []
    for i in others:
        place = book.suggest(ring.signatures[i]).found
        if place is not None:
            phase = (i - learnt[int(place.place)]) / rows
            found.append((int(place.place), phase - round(phase)))
    which, off = np.array(found).T
    return Revisits(len(others), which.astype(np.int64), off, book.threshold)


def draw(ring: Ring, rows: int, target: Path) -> None:
    """Save a picture: how like each row is to each other, and to those some time later."""
    every = 12
    differences = likeness(ring, every)
    figure = Figure(figsize=(10.0, 4.6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    end_s = len(ring.signatures) / RATE_HZ
    shown = left.imshow(differences, "magma", origin="lower", extent=(0.0, end_s, 0.0, end_s))
    left.set(xlabel="time [s]", ylabel="time [s]", title="difference D of the 24 sonars")
    figure.colorbar(shown, ax=left, shrink=0.8)
    lags = np.arange(1, len(differences) - 20)
    quartiles = np.array(
        [np.percentile(np.diagonal(differences, lag), (25, 50, 75)) for lag in lags]
    )
    right.fill_between(every * lags / RATE_HZ, quartiles[:, 0], quartiles[:, 2], alpha=0.3)
    right.plot(every * lags / RATE_HZ, quartiles[:, 1])
    for k in range(1, 6):
        right.axvline(k * rows / RATE_HZ, color="0.6", linewidth=0.8, linestyle="--")
    right.set(xlabel="time between two rows [s]", ylabel="D: median, quartiles", ylim=(0.0, None))
    right.set_title(f"rounds of about {rows / RATE_HZ:.0f} s")
    figure.savefig(target)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help=f"holds {FILE}")
    parser.add_argument("--plot", type=Path, help="draw how rounds show: .png, .svg or .pdf")
    options = parser.parse_args()
    ring = read_ring(options.folder)
    silent = 1.0 - np.mean([each.echoes for each in ring.signatures])
    print(f"{len(ring.signatures)} rows, {silent:.1%} of the readings silent")
    print("label, seconds later: rows, D unshifted, D at the best shift, turned left, right")
    for label in np.unique(ring.labels):
        for lag in (9, 18):
            found = turned(ring, label, lag)
            plain, best, _ = np.median(found, axis=0)
            left, right = np.mean(found[:, 2] > 0), np.mean(found[:, 2] < 0)
            print(
                f"{label:17} {lag / RATE_HZ:3.0f} s: {len(found):4} {plain:.3f} {best:.3f} "
                f"{left:4.0%} {right:4.0%}"
            )
    chosen = np.arange(0, len(ring.signatures) - max(LAGS), 20)
    index = SignatureIndex(ring.signatures, CONFIG)
    least = np.array([index.compare(ring.signatures[i]).differences().min(axis=1) for i in chosen])
    for lag in LAGS:
        later = least[range(len(chosen)), chosen + lag]
        print(f"{lag / RATE_HZ:5.1f} s later: D {np.median(later):.3f}")
    rows = round_rows(ring)
    again = revisits(ring, rows)
    print(
        f"rounds of {rows} rows; {PLACES} places of one, threshold {again.threshold:.3f}: of "
        f"{again.tried} rows of other rounds {len(again.places)} accepted, {again.right:.1%} of "
        f"them within {NEAR:.0%} of a round ({2 * NEAR:.0%} by chance)"
    )
    if options.plot is not None:
        draw(ring, rows, options.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
