"""Local map: the surfaces of a few keyframes in one frame, with which scans are matched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robotctl.estimation.slam.front_end.point_to_line import Bins, binned
from robotctl.estimation.slam.front_end.score_field import ScoreField, score_field
from robotctl.estimation.slam.front_end.surface import Floats, joined
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """Surfaces in one frame, sorted for the refinement and blurred for the search."""

    bins: Bins
    field: ScoreField


def local_map(keyframes: list[Keyframe], poses: list[SE2]) -> LocalMap:
    """Return the map of keyframes at poses in one frame."""
    surface = joined(
        [each.surface.moved(pose) for each, pose in zip(keyframes, poses, strict=True)]
    )
    return LocalMap(binned(surface), score_field(surface.outline))


def thinned(points: Floats, most: int) -> Floats:
    """Return at most so many of points (n, 2), evenly chosen."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).astype(np.int64)]
