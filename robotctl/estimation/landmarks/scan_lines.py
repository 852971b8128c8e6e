"""Walls and corners in a scan: split-and-merge, then weighted least squares (`line_fitting.py`).

Beams that hit something are taken in their order. They are cut where two neighbours lie so far
apart that no wall joins them unless the beams graze it at less than `grazing_deg` (the adaptive
breakpoints of Borges and Aldon, Line Extraction in 2D Range Images for Mobile Robotics, JIRS 40,
2004). A piece with a point too far from its line to be noise is split where it is farthest from the
line through its ends. Neighbours that fit one line are merged again. What is long enough then is
a wall; two neighbouring walls that end near where they meet make a corner.

A wall must be straight to within the noise. A bent one is cut into straight pieces.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.landmarks.line_fitting import (
    Array,
    BeamNoise,
    Corner,
    Line,
    across,
    fit_line,
    intersection,
)
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.sensors.range_scan import RangeScan

_FITS: Final = 3.0
"""Standard deviations from a line within which a point rather belongs to it."""
_ROUND: Final = 1.5
"""Maximum gap between the ends of a closed scan, in steps between beams."""


@dataclass(frozen=True, slots=True)
class ScanLinesConfig:
    """Criteria of a wall and a corner.

    Parameters
    ----------
    noise
        Of the beams.
    sigmas
        Standard deviations from a line beyond which a point is not on it, > 0.
    grazing_deg
        Beams that meet a surface at a smaller angle do not join its points, in (0, 90) [deg].
    least_points
        Points of a wall, >= 3.
    least_length_m
        Length of a wall [m], >= 0.
    corner_gap_m
        Walls that end farther from where they would meet than this and one beam more make no
        corner [m], >= 0.
    corner_deg
        Nor do walls with a smaller angle between them, in (0, 90) [deg].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    noise: BeamNoise = field(default_factory=BeamNoise)
    sigmas: float = 5.0
    grazing_deg: float = 10.0
    least_points: int = 6
    least_length_m: float = 0.3
    corner_gap_m: float = 0.2
    corner_deg: float = 30.0

    def __post_init__(self) -> None:
        if not 0.0 < self.sigmas < math.inf:
            raise ValueError(f"sigmas must be finite and > 0, found {self.sigmas}")
        for key in ("grazing_deg", "corner_deg"):
            if not 0.0 < getattr(self, key) < 90.0:
                raise ValueError(f"{key} must lie in (0, 90), found {getattr(self, key)}")
        if self.least_points < 3:
            raise ValueError(f"least_points must be >= 3, found {self.least_points}")
        for key in ("least_length_m", "corner_gap_m"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and >= 0, found {getattr(self, key)}")


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A wall as a scan shows it, in `base`.

    Parameters
    ----------
    line
        Its position.
    ends
        The first and the last point on it in the order of the beams, (2, 2) [m].
    spacing_m
        From the ends to the next points on it, (2,) [m].
    beams
        Which beams hit it.
    """

    line: Line
    ends: Array
    spacing_m: Array
    beams: NDArray[np.intp]

    @property
    def length_m(self) -> float:
        """Length from end to end [m]."""
        return float(np.hypot(*(self.ends[1] - self.ends[0])))


@dataclass(frozen=True, slots=True, eq=False)
class ScanLines:
    """Walls in the order of the beams, and corners."""

    segments: tuple[Segment, ...]
    corners: tuple[Corner, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """The end points of the beams that hit something."""

    beams: NDArray[np.intp]
    at: Array
    covariances: Array

    def line(self, piece: range) -> Line:
        """Return the line through a piece of the points."""
        chosen = slice(piece.start, piece.stop)
        return fit_line(self.at[chosen], self.covariances[chosen])

    def off(self, piece: range, line: Line) -> Array:
        """Return the distances of a piece from a line in standard deviations, (n,)."""
        chosen = slice(piece.start, piece.stop)
        variances = across(self.covariances[chosen], line.alpha_rad)
        found: Array = np.abs(line.distances_m(self.at[chosen])) / np.sqrt(variances)
        return found


def find_lines(scan: RangeScan, config: ScanLinesConfig | None = None) -> ScanLines:
    """Return the walls and corners in a scan.

    Parameters
    ----------
    scan
        Beams in the order of their directions; inf and nan are left out.
    config
        What counts as one.

    Raises
    ------
    ValueError
        If the directions of the beams do not increase or decrease throughout.
    """
    config = config or ScanLinesConfig()
    steps = np.diff(scan.angles_rad)
    if len(steps) and not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise ValueError("angles_rad must increase or decrease from beam to beam")
    hit = np.flatnonzero(scan.echoes)
    points, pieces = _pieces(scan, hit, config)
    is_round = _is_round(scan.angles_rad)
    if is_round and len(pieces) > 1:
        # Begin at an end of a wall, so that none is cut where the scan happens to begin.
        points, pieces = _pieces(scan, np.roll(hit, -pieces[1].start), config)
    segments = [_segment(points, piece) for piece in pieces if len(piece) >= config.least_points]
    segments = [each for each in segments if each.length_m >= config.least_length_m]
    return ScanLines(tuple(segments), tuple(_corners(segments, is_round, config)))


def _is_round(angles_rad: Array) -> bool:
    """Whether the last beam is next to the first."""
    if len(angles_rad) < 3:
        return False
    step = float(np.median(np.abs(np.diff(angles_rad))))
    return abs(float(angles_rad[-1] - angles_rad[0])) > math.tau - _ROUND * step


def _pieces(
    scan: RangeScan, beams: NDArray[np.intp], config: ScanLinesConfig
) -> tuple[_Points, list[range]]:
    """Return the end points of beams and their straight pieces, in their order."""
    points = _points(scan, beams, config.noise)
    runs = _runs(scan, beams, config)
    return points, [
        part
        for run in runs
        for part in _grown(points, _merged(points, _split(points, run, config), config))
    ]


def _points(scan: RangeScan, beams: NDArray[np.intp], noise: BeamNoise) -> _Points:
    """Return the end points of some beams in `base`."""
    ranges, angles = scan.ranges_m[beams], scan.angles_rad[beams]
    at = np.stack([scan.x_m + ranges * np.cos(angles), scan.y_m + ranges * np.sin(angles)], axis=1)
    return _Points(beams, at, noise.covariances(ranges, angles))


def _runs(scan: RangeScan, beams: NDArray[np.intp], config: ScanLinesConfig) -> list[range]:
    """Return pieces without a gap.

    Seen from the nearer of two neighbours, a surface that the beams meet at the angle grazing
    continues to the next beam at a distance of r sin(step) / sin(grazing - step).
    """
    if len(beams) == 0:
        return []
    ranges, angles = scan.ranges_m[beams], scan.angles_rad[beams]
    step = np.abs([wrap_angle(turn) for turn in np.diff(angles).tolist()])
    away = np.sqrt(
        np.maximum(
            ranges[1:] ** 2
            + ranges[:-1] ** 2
            - 2.0 * ranges[1:] * ranges[:-1] * np.cos(np.diff(angles)),
            0.0,
        )
    )
    nearer = np.minimum(ranges[1:], ranges[:-1])
    noise = config.noise.sigma_m + config.noise.sigma_per_m * ranges[1:]
    grazing = math.radians(config.grazing_deg)
    opening = np.sin(np.maximum(grazing - step, 1e-3))
    joined = away <= nearer * np.sin(step) / opening + config.sigmas * noise
    joined &= step < grazing
    cuts = [0, *(np.flatnonzero(~joined) + 1).tolist(), len(beams)]
    return [range(begin, end) for begin, end in itertools.pairwise(cuts)]


def _split(points: _Points, run: range, config: ScanLinesConfig) -> list[range]:
    """Return the straight parts of a piece; a point of a split belongs to the latter."""
    straight, waiting = [], [run]
    while waiting:
        piece = waiting.pop()
        if len(piece) < 3 or _is_straight(points, piece, config):
            straight.append(piece)
            continue
        first, last = points.at[piece.start], points.at[piece.stop - 1]
        away = points.at[piece.start : piece.stop] - first
        chord = last - first
        aside = np.abs(away[:, 0] * chord[1] - away[:, 1] * chord[0])
        if not chord.any():
            aside = np.hypot(*away.T)
        at = piece.start + min(max(int(np.argmax(aside)), 1), len(piece) - 1)
        waiting += [range(at, piece.stop), range(piece.start, at)]
    return straight


def _is_straight(points: _Points, piece: range, config: ScanLinesConfig) -> bool:
    """Whether all points of a piece, two or more, lie on one line."""
    try:
        line = points.line(piece)
    except ValueError:  # no direction
        return False
    return float(points.off(piece, line).max()) <= config.sigmas


def _merged(points: _Points, pieces: list[range], config: ScanLinesConfig) -> list[range]:
    """Join neighbours that are one line, until there are none."""
    done: list[range] = []
    for piece in pieces:
        last = piece
        while done and _is_straight(points, range(done[-1].start, last.stop), config):
            last = range(done.pop().start, last.stop)
        done.append(last)
    return done


def _grown(points: _Points, pieces: list[range]) -> list[range]:
    """Let long pieces take what fits them from shorter neighbours: splits err by a point or two."""
    grown = list(pieces)
    for i in sorted(range(len(grown)), key=lambda i: -len(pieces[i])):
        if len(grown[i]) < 3:
            continue
        line = points.line(grown[i])
        for j, step in ((i - 1, -1), (i + 1, 1)):
            if not (0 <= j < len(grown) and len(pieces[j]) < len(pieces[i])):
                continue
            fits = points.off(grown[j], line)[::step] <= _FITS
            taken = len(fits) if fits.all() else int(np.argmin(fits))
            if step > 0:
                grown[i] = range(grown[i].start, grown[i].stop + taken)
                grown[j] = range(grown[j].start + taken, grown[j].stop)
            else:
                grown[i] = range(grown[i].start - taken, grown[i].stop)
                grown[j] = range(grown[j].start, grown[j].stop - taken)
    return [piece for piece in grown if piece]


def _segment(points: _Points, piece: range) -> Segment:
    """Return the wall through a piece."""
    line = points.line(piece)
    outer = points.at[[piece.start, piece.stop - 1]]
    inner = points.at[[piece.start + 1, piece.stop - 2]]
    ends = outer - np.outer(line.distances_m(outer), line.normal)
    spacing_m: Array = np.hypot(*(inner - outer).T)
    return Segment(line, ends, spacing_m, points.beams[piece.start : piece.stop])


def _corners(segments: list[Segment], is_round: bool, config: ScanLinesConfig) -> list[Corner]:
    """Return the corners of neighbouring walls."""
    pairs = list(itertools.pairwise(segments))
    if is_round and len(segments) > 2:
        pairs.append((segments[-1], segments[0]))
    found = []
    for before, after in pairs:
        sine = before.line.normal @ [-after.line.normal[1], after.line.normal[0]]
        if abs(sine) < math.sin(math.radians(config.corner_deg)):
            continue
        corner = intersection(before.line, after.line)
        gaps_m = np.hypot(*(corner.position - [before.ends[1], after.ends[0]]).T)
        spacing_m = np.array([before.spacing_m[1], after.spacing_m[0]])
        if np.all(gaps_m <= config.corner_gap_m + spacing_m):
            found.append(corner)
    return found
