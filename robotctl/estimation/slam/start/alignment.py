"""Parts of a graph without a known pose, laid onto known points and positions.

A drive between surveyed landmarks, or one with a GNSS, knows its own shape and not where that lies.
It is moved as a whole to where it fits best what is known: by places, if it tells enough of them
(Kabsch 1976; Umeyama 1991), in the plane else by bearings and ranges, too. Then points that it sees
are known to other parts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, TypeAlias

import numpy as np

from robotctl.estimation.slam.factors.landmarks import BEARING, RANGE, RANGE_BEARING, SEEN_2D
from robotctl.estimation.slam.factors.prior import POSITION_2D, POSITION_3D
from robotctl.estimation.slam.graph.factor import Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, blocks_of
from robotctl.estimation.slam.graph.variables import POINT2, SE2, SE3, Floats
from robotctl.estimation.slam.start.chordal import matrices, quaternions
from robotctl.estimation.slam.start.points import Mask, place_seen, sightings
from robotctl.estimation.slam.start.resection import Outlook, best_pose

_MEASURES_KNOWN: Final = (SEEN_2D, RANGE_BEARING, BEARING, RANGE, POSITION_2D)
Pairs: TypeAlias = tuple[Ints, Floats, Floats]
"""Rows of poses, where these see something now, and where it is known to be; (m,) and (m, d)."""


def align_parts(
    graph: FactorGraph, values: Values, known: dict[object, Mask], parts: Ints, is_placed: Mask
) -> None:
    """Move the poses of parts that are not placed; points that placed parts see become known.

    Parameters
    ----------
    graph
        With poses.
    values
        Those of poses and points are changed.
    known
        Of each kind, which points are known, (n,); changed.
    parts
        Number of the part of each pose, (n,), from 0.
    is_placed
        Which parts are where they belong, (parts,); changed.
    """
    poses = graph.poses
    if poses is None:
        return
    order = np.argsort(parts, kind="stable")
    bounds = np.searchsorted(parts[order], np.arange(len(is_placed) + 1))
    while not np.all(is_placed):
        place_seen(graph, values, known, is_placed[parts])
        fits = _fits(graph, values, known, parts, is_placed)
        if not fits:
            return
        for part, (R, t) in fits.items():
            own = order[bounds[part] : bounds[part + 1]]
            values[poses][own] = _moved(values[poses][own], R, t)
            is_placed[part] = True


def _fits(
    graph: FactorGraph, values: Values, known: dict[object, Mask], parts: Ints, is_placed: Mask
) -> dict[int, tuple[Floats, Floats]]:
    """Return by which rotation and shift to move parts: those that are told best what is known."""
    wanted = ~is_placed[parts]
    rows, here, there = _pairs(graph, values, known, wanted)
    by_part = _grouped(parts[rows], len(is_placed))
    enough = [part for part, mine in by_part.items() if len(mine) >= values_needed(graph)]
    if enough:
        return {part: rigid_fit(here[by_part[part]], there[by_part[part]]) for part in enough}
    views: dict[int, list[Outlook]] = {}
    for part, outlook in _outlooks(graph, values, known, wanted, parts, len(is_placed)):
        views.setdefault(part, []).append(outlook)
    told = {part: sum(each.numbers for each in own) for part, own in views.items()}
    resected = {part: best_pose(own) for part, own in views.items() if told[part] >= SE2.dof}
    # One place alone leaves the turn open; what is there stays.
    return resected or {part: rigid_fit(here[mine], there[mine]) for part, mine in by_part.items()}


def values_needed(graph: FactorGraph) -> int:
    """Return how many places of a part, seen and known, tell where all of it is."""
    return graph.poses.positions if graph.poses is not None else 2


def _grouped(parts: Ints, count: int) -> dict[int, Ints]:
    """Return for each part that occurs in it the indices of an array, (m,)."""
    order = np.argsort(parts, kind="stable")
    bounds = np.searchsorted(parts[order], np.arange(count + 1))
    return {
        part: order[bounds[part] : bounds[part + 1]]
        for part in np.flatnonzero(np.diff(bounds)).tolist()
    }


def _outlooks(
    graph: FactorGraph, values: Values, known: dict[object, Mask], wanted: Mask, parts: Ints,
    count: int,
) -> Iterator[tuple[int, Outlook]]:  # fmt: skip
    """Yield what the wanted poses in the plane, (n,), measure of what is known, part by part."""
    for block in blocks_of(graph, *_MEASURES_KNOWN):
        poses = block.variables[0]
        mask = wanted[poses]
        if len(block.variables) == 2:
            mask &= known[POINT2][block.variables[1]]
        own = block.take(mask)
        for part, mine in _grouped(parts[own.variables[0]], count).items():
            these = own.take(mine)
            points = values[POINT2][these.variables[1]] if len(these.variables) == 2 else None
            yield part, Outlook(these, values[SE2][these.variables[0]], points)


def _pairs(graph: FactorGraph, values: Values, known: dict[object, Mask], wanted: Mask) -> Pairs:
    """Return what the wanted poses, (n,), say of places that are known."""
    d = graph.poses.positions if graph.poses is not None else 2
    rows, here, there = [np.empty(0, np.int64)], [np.empty((0, d))], [np.empty((0, d))]
    for kind, poses, points, places in sightings(graph, values, wanted):
        good = known[kind][points]
        rows.append(poses[good])
        here.append(places[good])
        there.append(values[kind][points[good]])
    for block in blocks_of(graph, POSITION_2D, POSITION_3D):
        own = block.take(wanted[block.variables[0]])
        rows.append(own.variables[0])
        here.append(values[own.kind.variables[0]][own.variables[0], :d])
        there.append(own.measurements)
    return np.concatenate(rows), np.concatenate(here), np.concatenate(there)


def rigid_fit(here: Floats, there: Floats) -> tuple[Floats, Floats]:
    """Return the rotation (d, d) and shift (d,) that move points (m, d) onto others best."""
    a, b = here.mean(axis=0), there.mean(axis=0)
    U, _, V = np.linalg.svd((there - b).T @ (here - a))
    sign = np.ones(len(a))
    sign[-1] = np.linalg.det(U @ V)
    R = (U * sign) @ V
    return R, b - R @ a


def _moved(poses: Floats, R: Floats, t: Floats) -> Floats:
    """Return poses (n, size) moved by a rotation and a shift."""
    d = len(t)
    result = poses.copy()
    result[:, :d] = poses[:, :d] @ R.T + t
    if poses.shape[1] == SE3.size:
        result[:, d:] = quaternions(R @ matrices(np.ascontiguousarray(poses[:, d:])))
    else:
        result[:, d] += np.arctan2(R[1, 0], R[0, 0])
    return result
