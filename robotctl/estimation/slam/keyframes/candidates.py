"""Candidates for loops: old keyframes that a keyframe may be beside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.recogniser import Candidate, PlaceRecogniser
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.model.geometry.se2 import SE2

POSITION: Final = "position"
"""Finder of a candidate that the map itself suggests, since it lies near."""


@dataclass(frozen=True, slots=True, eq=False)
class PossiblePlaces:
    """Keyframes that a new one may be at.

    Parameters
    ----------
    keyframe
        Number of the new one.
    numbers
        Numbers of the old ones, (n,).
    turns_rad, within_rad
        Heading of the new one in each, and how far off it may be to either side, (n,) [rad].
    """

    keyframe: int
    numbers: NDArray[np.int64]
    turns_rad: Floats
    within_rad: Floats


class ScanRecogniser(PlaceRecogniser[PossiblePlaces, Candidate[int]], Protocol):
    """Recognises keyframes by what was seen around them; it has seen the first `len` of them."""

    def __len__(self) -> int:
        """Return the number of keyframes that it has seen."""

    def add(self, seen: list[tuple[SE2, Floats]]) -> None:
        """Take in the next keyframe: what it and those before it saw, points at poses in it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoopCandidate(Candidate[int]):
    """An old keyframe that a keyframe may be beside, with its pose in that.

    Parameters
    ----------
    keyframe
        Number of the keyframe of now.
    found_by
        Name of what suggests it.
    shift_m, turn_rad
        Half sides of the search window around the pose [m], [rad].
    sigma_m, sigma_rad
        Standard deviations of the pose [m], [rad]; inf: all of the window is equally likely.
    limit_m
        Maximum error of the map there [m].
    """

    keyframe: int
    found_by: str
    shift_m: float
    turn_rad: float
    sigma_m: float = math.inf
    sigma_rad: float = math.inf
    limit_m: float = math.inf


def nearest_of_each_visit(others: NDArray[np.int64], away_m: Floats, gap: int) -> Sequence[int]:
    """Return the keyframe nearest of each run of numbers without a gap, of `others` (n,)."""
    if len(others) == 0:
        return []
    runs = np.split(np.arange(len(others)), np.flatnonzero(np.diff(others) > gap) + 1)
    return [int(others[run[np.argmin(away_m[run])]]) for run in runs]
