"""Parts of a graph without a known pose, laid onto known points and positions.

A drive between surveyed landmarks, or one with a GNSS, knows its own shape and not where that lies.
It is moved as a whole to where it fits best what is known (Kabsch 1976; Umeyama 1991); then points
that it sees are known to other parts.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from robotctl.estimation.slam.factors.prior import POSITION_2D, POSITION_3D
from robotctl.estimation.slam.graph.factor import Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, blocks_of
from robotctl.estimation.slam.graph.variables import SE3, Floats
from robotctl.estimation.slam.start.chordal import matrices, quaternions
from robotctl.estimation.slam.start.points import Mask, place_seen, sightings

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
        rows, here, there = _pairs(graph, values, known, ~is_placed[parts])
        counts = np.bincount(parts[rows], minlength=len(is_placed))
        # Fewer leave a turn open; such parts wait for what others may see.
        chosen = np.flatnonzero(counts >= poses.positions)
        if len(chosen) == 0:
            chosen = np.flatnonzero(counts)
        if len(chosen) == 0:
            return
        by_part = np.argsort(parts[rows], kind="stable")
        begins = np.searchsorted(parts[rows][by_part], np.arange(len(is_placed) + 1))
        for part in chosen.tolist():
            mine = by_part[begins[part] : begins[part + 1]]
            own = order[bounds[part] : bounds[part + 1]]
            R, t = rigid_fit(here[mine], there[mine])
            values[poses][own] = _moved(values[poses][own], R, t)
        is_placed[chosen] = True


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
