"""Shape of the surroundings of keyframes: finds places that look alike, whatever the heading.

What the last keyframes saw around is counted in rings and sectors; a turn of the robot shifts the
sectors, so the best of all turns comes from one Fourier transform. Kim, Kim: Scan Context, IROS
2018, does so for scans in space.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.grown import Grown
from robotctl.estimation.places.recogniser import Candidate, Recognition
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.candidates import PossiblePlaces
from robotctl.estimation.slam_tuning import ShapeConfig
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2

REACH_M: Final = 6.0
"""Radius of a keyframe's surroundings [m], for points and other keyframes."""
AROUND: Final = 20
"""Keyframes before one, at most, that saw its surroundings."""
_RINGS: Final = 16
_SECTORS: Final = 60
_CELL_M: Final = 0.1
_CELLS: Final = round(REACH_M / _CELL_M)
"""Cells to each side of a keyframe."""
_MOST: Final = 3.0
"""Cells of a bin that count: a wall along the line of sight is no more than one across it."""
_COMPARED: Final = 1000
"""Keyframes that are compared at all turns, those most alike by rings."""


def shape_of(points: Floats) -> Floats:
    """Return the shape of points (n, 2) around the origin: (rings, sectors), of norm 1 or 0."""
    shape = np.minimum(_cells_by_bin(points, _BINS), _MOST).reshape(_RINGS, _SECTORS)
    # A robot that comes by a little beside sees things in the next bin.
    beside = np.concatenate((shape[:, -1:], shape, shape[:, :1]), axis=1)
    shape = shape + 0.5 * (beside[:, :-2] + beside[:, 2:])
    beside = np.pad(shape, ((1, 1), (0, 0)))
    shape = shape + 0.5 * (beside[:-2] + beside[2:])
    result: Floats = shape / max(float(np.linalg.norm(shape)), 1e-9)
    return result


def _bins() -> NDArray[np.int64]:
    """Return ring * sectors + sector of each cell around the origin, (n, n); -1: out of reach."""
    side_m = (np.arange(2 * _CELLS) - _CELLS + 0.5) * _CELL_M
    x, y = np.meshgrid(side_m, side_m, indexing="ij")
    away = np.hypot(x, y)
    ring = (away * (_RINGS / REACH_M)).astype(np.int64)
    sector = np.floor(np.arctan2(y, x) * (_SECTORS / (2.0 * np.pi))).astype(np.int64) % _SECTORS
    return np.where(away < REACH_M, ring * _SECTORS + sector, -1)


_BINS: Final = _bins()


@compiled
def _cells_by_bin(points: Floats, bins: NDArray[np.int64]) -> Floats:
    """Return the number of cells with a point (n, 2) in each ring and sector, (bins,)."""
    counts = np.zeros(_RINGS * _SECTORS)
    is_seen = np.zeros(bins.shape, np.bool_)
    for k in range(len(points)):
        column = int(np.floor(points[k, 0] / _CELL_M)) + _CELLS
        row = int(np.floor(points[k, 1] / _CELL_M)) + _CELLS
        if min(column, row) < 0 or max(column, row) >= 2 * _CELLS or is_seen[column, row]:
            continue
        is_seen[column, row] = True
        if bins[column, row] >= 0:
            counts[bins[column, row]] += 1.0
    return counts


class Shapes:
    """Shapes of the surroundings of all keyframes, by number."""

    def __init__(self, config: ShapeConfig | None = None) -> None:
        self._config = config or ShapeConfig()
        self._spectra = Grown((_RINGS, _SECTORS // 2 + 1), np.complex64)
        self._rings = Grown((_RINGS,), np.float32)

    def __len__(self) -> int:
        return self._rings.size

    def add(self, seen: list[tuple[SE2, Floats]]) -> None:
        """Add the next keyframe: what was seen around it, points at poses in it."""
        near = [
            moved(pose, points) for pose, points in seen if np.hypot(pose.x_m, pose.y_m) < REACH_M
        ]
        shape = shape_of(np.concatenate(near) if near else np.empty((0, 2)))
        self._spectra.add(np.fft.rfft(shape, axis=1)[None])
        self._rings.add(np.linalg.norm(shape, axis=1)[None])

    def suggest(self, sensed: PossiblePlaces) -> Recognition[Candidate[int]]:
        """Return the keyframes whose surroundings look most alike, the best first.

        The score is the correlation of the two; the pose has the heading, to half a sector.
        """
        among = sensed.numbers
        if len(among) == 0:
            return Recognition((), "no place is possible")
        chosen = np.arange(len(among))
        if len(among) > _COMPARED:
            # No turn makes rings more alike than their norms say (Cauchy, Schwarz).
            bounds = self._rings.view[among] @ self._rings.view[sensed.keyframe]
            chosen = np.argpartition(-bounds, _COMPARED)[:_COMPARED]
        spectra = self._spectra.view
        products = np.einsum("nrs,rs->ns", spectra[among[chosen]], spectra[sensed.keyframe].conj())
        by_turn = np.fft.irfft(products, n=_SECTORS, axis=1)
        turns = np.arange(_SECTORS) * (2.0 * np.pi / _SECTORS)
        off = (turns - sensed.turns_rad[chosen, None] + np.pi) % (2.0 * np.pi) - np.pi
        by_turn[np.abs(off) > sensed.within_rad[chosen, None]] = -1.0
        scores, shifts = by_turn.max(axis=1), by_turn.argmax(axis=1)
        result: list[Candidate[int]] = []
        for row in np.argsort(-scores, kind="stable").tolist():
            if len(result) == self._config.candidates:
                break
            other, score = int(among[chosen[row]]), float(scores[row])
            if all(abs(other - each.place) > self._config.apart for each in result):
                turn_rad = math.remainder(float(turns[shifts[row]]), 2.0 * math.pi)
                result.append(Candidate(other, SE2(0.0, 0.0, turn_rad), score))
        return Recognition(tuple(each for each in result if each.score > self._config.least_score))
