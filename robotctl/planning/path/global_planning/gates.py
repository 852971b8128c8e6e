"""Straight pieces through narrow places, where a body has no room to turn.

A path over cells leads through a door as the cells lie, and its corners may be in the middle of
it. A body that hardly fits must be in line before it enters and stay so until it is through. All
lengths are in cells of the map, but where [m] is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.footprint_arrays import outlines
from robotctl.planning.map.planning_map import APART, PlanningMap, body_hits

_IN_LINE_M: Final = 0.3
"""Distance before a narrow place from which on a body is to be in line with it [m]."""
_TILTS: Final = np.radians(np.arange(-45.0, 46.0, 1.5))
"""Angles between the way over the cells and the straight piece that are tried [rad]."""
_OFFSET: Final = 0.25
_OFFSET_M: Final = 0.005
"""Least distances between the lines that are tried at each angle, in cells and [m]."""
_ASIDE_M: Final = 0.15
"""How far they lie aside of the narrowest cell at most [m]."""
_STEP: Final = 0.5
"""Distance between two checks along a line, and between two points of the outline."""
_LONGEST: Final = 2.0
"""Length of a line at most, in lengths of the way over the cells that it replaces."""


class Gate(NamedTuple):
    """A straight piece in place of a part of a path."""

    first: int
    """Number of the cell up to which the path stays as it is."""
    last: int
    """The same of the cell from which on it does."""
    ends: NDArray[np.float64]
    """(2, 2): x and y of its ends."""


class _Body(NamedTuple):
    """A body as `PlanningMap` has it, and points of its outline, (n, 2)."""

    samples: NDArray[np.float64]
    discs: NDArray[np.float64]
    outline: NDArray[np.float64]


class _Run(NamedTuple):
    """Cells of a path between two places where the body can turn."""

    before: int
    """Last cell with room to turn, as its number along the path."""
    narrowest: int
    after: int
    """First cell with room again."""


def gated(cells: NDArray[np.int64], space: PlanningMap, margin_m: float) -> Iterator[Gate]:
    """Yield the straight pieces through the narrow places of a path, in their order.

    A place is narrow where the body cannot turn, and has less than a margin and a cell on one of
    its sides. Where no straight piece fits, or the path begins or ends there, none is given.

    Parameters
    ----------
    cells
        (n, 2) rows and columns, each a neighbour of the one before.
    margin_m
        Of the planner [m].
    """
    room = space.clearance[cells[:, 0], cells[:, 1]]
    points = cells[:, ::-1] + 0.5
    side_m, roomy, begin = space.grid.resolution_m, space.circumscribed + APART, 0
    half_m = 0.5 * (space.footprint.left_m + space.footprint.right_m)
    narrow = min((half_m + margin_m) / side_m + 1.0, space.circumscribed)
    around = space.samples
    if space.footprint.corners:
        around = outlines(space.footprint, side_m, _STEP)
    body = _Body(space.samples, space.discs, around)
    offset = max(_OFFSET, _OFFSET_M / side_m)
    tried = round(_ASIDE_M / side_m / offset)
    for run in _runs(room, narrow, roomy):
        way = points[run.after] - points[run.before]
        longest = _LONGEST * (run.after - run.before) + 2.0 * space.circumscribed
        found, *line = _middle_line(
            space.blocked, space.clearance, body, points[run.narrowest],
            math.atan2(way[1], way[0]), tried, offset, roomy, longest, _IN_LINE_M / side_m,
        )  # fmt: skip
        if not found:
            continue
        ends = np.array(line).reshape(2, 2)
        along = (ends[1] - ends[0]) / max(math.dist(*ends.tolist()), 1e-9)
        passed = (points - ends[0]) @ along > 0.0
        first = run.before - int(np.argmin(passed[run.before :: -1]))
        left = (points - ends[1]) @ along < 0.0
        last = run.after + int(np.argmin(left[run.after :]))
        if passed[first] or left[last] or first < begin:
            continue
        begin = last
        yield Gate(first, last, ends)


def _runs(room: NDArray[np.float32], narrow: float, roomy: float) -> Iterator[_Run]:
    """Yield the runs without room to turn that hold a narrow cell, but for those at the ends."""
    without = np.concatenate([[False], room < roomy, [False]])
    edges = np.flatnonzero(without[1:] != without[:-1])
    for first, end in zip(edges[0::2].tolist(), edges[1::2].tolist(), strict=True):
        inside = room[first:end]
        if first == 0 or end == len(room) or inside.min() >= narrow:
            continue
        least = np.flatnonzero(inside == inside.min())
        yield _Run(first - 1, first + int(least[len(least) // 2]), end)


@compiled
def _middle_line(
    blocked: NDArray[np.bool_],
    clearance: NDArray[np.float32],
    body: _Body,
    middle: NDArray[np.float64],
    direction: float,
    tried: int,
    spacing: float,
    roomy: float,
    longest: float,
    lead: float,
) -> tuple[bool, float, float, float, float]:
    """Return whether a line leads through, and its ends, in the middle of the most room.

    At each angle the lines beside each other that are free make a band: the widest counts, the mean
    of those that are equally wide.
    """
    widest, ties, tilts, offsets = 0, 0, 0.0, 0.0
    for tilt in _TILTS:
        c, s = math.cos(direction + tilt), math.sin(direction + tilt)
        band = 0
        for i in range(-tried, tried + 1):
            offset = i * spacing
            pose = middle[0] - s * offset, middle[1] + c * offset, direction + tilt
            length = _free_length(blocked, clearance, body, pose, 1.0, roomy, longest)
            if length >= 0.0:
                length = _free_length(blocked, clearance, body, pose, -1.0, roomy, longest)
            band = band + 1 if length >= 0.0 else 0
            if band > widest:
                widest, ties, tilts, offsets = band, 0, 0.0, 0.0
            if 0 < band == widest:
                ties += 1
                tilts += tilt
                offsets += offset - 0.5 * (band - 1) * spacing
    if widest == 0:
        return False, 0.0, 0.0, 0.0, 0.0
    angle, offset = direction + tilts / ties, offsets / ties
    c, s = math.cos(angle), math.sin(angle)
    x, y = middle[0] - s * offset, middle[1] + c * offset
    pose = x, y, angle
    ahead = _free_length(blocked, clearance, body, pose, 1.0, roomy, longest)
    back = _free_length(blocked, clearance, body, pose, -1.0, roomy, longest)
    if ahead < 0.0 or back < 0.0:
        return False, 0.0, 0.0, 0.0, 0.0
    back += _lead(clearance, (x - back * c, y - back * s), (-c, -s), roomy, lead)
    ahead += _lead(clearance, (x + ahead * c, y + ahead * s), (c, s), roomy, lead)
    return True, x - back * c, y - back * s, x + ahead * c, y + ahead * s


@compiled
def _free_length(
    blocked: NDArray[np.bool_],
    clearance: NDArray[np.float32],
    body: _Body,
    pose: tuple[float, float, float],
    gear: float,
    roomy: float,
    longest: float,
) -> float:
    """Return how far the body drives straight from a pose until it can turn; -1: it is stopped.

    What is in its way it meets with its outline first.
    """
    x, y, angle = pose
    step_x, step_y = gear * _STEP * math.cos(angle), gear * _STEP * math.sin(angle)
    rows, columns = clearance.shape
    for i in range(int(longest / _STEP)):
        at_x, at_y = x + i * step_x, y + i * step_y
        points = body.outline if i > 0 else body.samples
        if body_hits(blocked, clearance, points, body.discs, at_x, at_y, angle):
            return -1.0
        row, column = math.floor(at_y), math.floor(at_x)
        if 0 <= row < rows and 0 <= column < columns and clearance[row, column] >= roomy:
            return i * _STEP
    return -1.0


@compiled
def _lead(
    clearance: NDArray[np.float32],
    place: tuple[float, float],
    way: tuple[float, float],
    roomy: float,
    lead: float,
) -> float:
    """Return how far there is room to turn on a straight way from a place, at most `lead`."""
    rows, columns = clearance.shape
    for i in range(1, int(lead / _STEP) + 1):
        row = math.floor(place[1] + i * _STEP * way[1])
        column = math.floor(place[0] + i * _STEP * way[0])
        if not (0 <= row < rows and 0 <= column < columns) or clearance[row, column] < roomy:
            return (i - 1) * _STEP
    return int(lead / _STEP) * _STEP
