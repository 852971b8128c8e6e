"""Initial values of points, given the poses: where they were seen, or where sightings meet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.factors.landmarks import BEARING, RANGE, RANGE_BEARING, SEEN_2D
from robotctl.estimation.slam.factors.points_in_space import RANGE_3D, SEEN_3D
from robotctl.estimation.slam.graph.factor import FactorKind, Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, blocks_of
from robotctl.estimation.slam.graph.variables import (
    POINT2,
    POINT3,
    SE2,
    SE3,
    Floats,
    VariableKind,
)
from robotctl.estimation.slam.start.chordal import matrices

Mask: TypeAlias = NDArray[np.bool_]

_DIRECTIONS: Final = 32
_STEPS: Final = 10
_DAMPING: Final = 1e-6


def _from_pose(poses: Floats, x: Floats, y: Floats) -> Floats:
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.column_stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y])


def _polar(poses: Floats, z: Floats) -> Floats:
    return _from_pose(poses, z[:, 0] * np.cos(z[:, 1]), z[:, 0] * np.sin(z[:, 1]))


def _in_space(poses: Floats, z: Floats) -> Floats:
    R = matrices(np.ascontiguousarray(poses[:, 3:]))
    result: Floats = poses[:, :3] + np.einsum("nij,nj->ni", R, z)
    return result


_SEEN: Final[dict[FactorKind, Callable[[Floats, Floats], Floats]]] = {
    SEEN_2D: lambda poses, z: _from_pose(poses, z[:, 0], z[:, 1]),
    RANGE_BEARING: _polar,
    SEEN_3D: _in_space,
}
"""Functions of the place at which a pose sees a point, by kind of factor."""


def sightings(
    graph: FactorGraph, values: Values, is_placed: Mask
) -> Iterator[tuple[VariableKind, Ints, Ints, Floats]]:
    """Yield where poses see points, for factors that alone tell it.

    Parameters
    ----------
    graph, values
        Of the poses the values are used.
    is_placed
        Whose sightings are wanted, of the rows of poses, (n,).

    Yields
    ------
    kind, poses, points, places
        Kind of the points, rows of both, (m,), and places in the world, (m, dof).
    """
    for block in blocks_of(graph, *_SEEN):
        own = block.take(is_placed[block.variables[0]])
        poses, kind = own.variables[0], own.kind.variables[1]
        at = values[own.kind.variables[0]][poses]
        yield kind, poses, own.variables[1], _SEEN[own.kind](at, own.measurements)


def place_seen(
    graph: FactorGraph, values: Values, known: dict[object, Mask], is_placed: Mask
) -> None:
    """Set points that are not known yet to where a placed pose, (n,), first sees them."""
    for kind, _, points, places in sightings(graph, values, is_placed):
        rows, firsts = np.unique(points, return_index=True)
        new = ~known[kind][rows]
        values[kind][rows[new]] = places[firsts[new]]
        known[kind][rows[new]] = True


def place_points(graph: FactorGraph, values: Values, known: dict[object, Mask]) -> None:
    """Set the values of points that are not known, from the poses that saw them.

    A point that one factor alone can place stands where it was first seen; one with bearings or
    ranges only, where these fit best.
    """
    if graph.poses is not None:
        place_seen(graph, values, known, np.ones(len(graph.ids[graph.poses]), np.bool_))
    _place_by_bearings(graph, values, known)
    for kind, poses_kind, factor in ((POINT2, SE2, RANGE), (POINT3, SE3, RANGE_3D)):
        for block in blocks_of(graph, factor):
            poses, points = block.variables
            for row in np.flatnonzero(~known[kind]):
                mine = points == row
                if np.any(mine):
                    centres = values[poses_kind][poses[mine], : kind.dof]
                    values[kind][row] = meeting_point(centres, block.measurements[mine, 0])
                    known[kind][row] = True


def _place_by_bearings(graph: FactorGraph, values: Values, known: dict[object, Mask]) -> None:
    """Set points that are seen by bearing to where the lines meet, by least squares."""
    for block in blocks_of(graph, BEARING):
        poses, points = block.variables
        at = values[SE2][poses]
        angle = at[:, 2] + block.measurements[:, 0]
        normal = np.column_stack([-np.sin(angle), np.cos(angle)])
        along = np.einsum("ni,ni->n", normal, at[:, :2])
        for row in np.flatnonzero(~known[POINT2]):
            mine = points == row
            if np.any(mine):
                # Nearly parallel lines meet anywhere: a point ahead of the first pose is likelier.
                ahead = at[mine][0, :2] + [np.cos(angle[mine][0]), np.sin(angle[mine][0])]
                N = normal[mine]
                A = N.T @ N + _DAMPING * np.eye(2)
                values[POINT2][row] = np.linalg.solve(A, N.T @ along[mine] + _DAMPING * ahead)
                known[POINT2][row] = True


def meeting_point(centres: Floats, ranges: Floats) -> Floats:
    """Return the point with such distances from such places, as well as it fits.

    Ranges from places on a line fit two points; one of them is returned.

    Parameters
    ----------
    centres
        (n, 2) or (n, 3) [m].
    ranges
        (n,) [m].
    """
    d = centres.shape[1]
    points = centres[0] + ranges[0] * _directions(d)  # each starts from another place
    for _ in range(_STEPS):
        away = points[:, np.newaxis] - centres
        distances = np.maximum(np.linalg.norm(away, axis=2), 1e-9)
        J = away / distances[..., np.newaxis]
        A = J.mT @ J + _DAMPING * np.eye(d)
        gradients = J.mT @ (distances - ranges)[..., np.newaxis]
        points = points - np.linalg.solve(A, gradients)[..., 0]
    distances = np.linalg.norm(points[:, np.newaxis] - centres, axis=2)
    best: Floats = points[np.sum((distances - ranges) ** 2, axis=1).argmin()]
    return best


def _directions(d: int) -> Floats:
    angle = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    if d == 2:
        return np.column_stack([np.cos(angle), np.sin(angle)])
    # A spiral over the sphere by the golden angle.
    z = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
