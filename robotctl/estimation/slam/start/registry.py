"""The starts by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.prior import (
    PRIOR_2D,
    PRIOR_3D,
    PRIOR_POINT_2D,
    PRIOR_POINT_3D,
)
from robotctl.estimation.slam.graph.checks import check_values
from robotctl.estimation.slam.graph.factor import Ints, is_definite
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, blocks_of
from robotctl.estimation.slam.graph.variables import Floats, VariableKind
from robotctl.estimation.slam.start.alignment import align_parts
from robotctl.estimation.slam.start.chordal import chordal_poses
from robotctl.estimation.slam.start.points import Mask, place_points
from robotctl.estimation.slam.start.spanning import parts_of, relative_poses, tree_poses


def _odometry(graph: FactorGraph, poses: Floats, fixed: Ints, known: Mask) -> Floats:
    return tree_poses(graph, poses, fixed, known, by_odometry=True)


def _tree(graph: FactorGraph, poses: Floats, fixed: Ints, known: Mask) -> Floats:
    return tree_poses(graph, poses, fixed, known, by_odometry=False)


def _chordal(graph: FactorGraph, poses: Floats, fixed: Ints, known: Mask) -> Floats:
    tree = _odometry(graph, poses, fixed, known)
    return chordal_poses(graph, tree, fixed) if len(relative_poses(graph)[0]) else tree


FILE: Final = "file"
STARTS: Final[dict[str, Callable[[FactorGraph, Floats, Ints, Mask], Floats]]] = {
    FILE: _odometry,
    "odometry": _odometry,
    "tree": _tree,
    "chordal": _chordal,
}
"""How poses begin: of a graph, values to begin at, rows of the fixed ones, and which others are
good to begin at. From the file those begin along the odometry that it does not give."""


def start_values(
    graph: FactorGraph, values: Values, known: dict[VariableKind, Mask], fixed: Ints, name: str
) -> Values:
    """Return values to begin at.

    Parameters
    ----------
    graph, values, known
        As read: values that are not known are placeholders.
    fixed
        Numbers of the fixed variables; they keep their values, and others are placed by them.
    name
        One of `STARTS`. Points follow from the poses, but from the file those that it has.

    Raises
    ------
    ValueError
        If values have other shapes than the variables, or are no numbers.
    """
    check_values(graph.counts, values, numbers=True)
    result = {kind: each.copy() for kind, each in values.items()}
    from_file = name == FILE or graph.poses is None
    is_given = {kind: known[kind] & from_file for kind in graph.ids}
    for kind, rows in graph.rows(np.asarray(fixed, np.int64)).items():
        is_given[kind][rows] = True
    has_prior = _begin_at_priors(graph, result, is_given)
    found: dict[object, Mask] = {kind: mask | has_prior[kind] for kind, mask in is_given.items()}
    poses = graph.poses
    if poses is not None:
        given = np.flatnonzero(is_given[poses])
        result[poses] = STARTS[name](graph, result[poses], given, has_prior[poses])
        parts = parts_of(graph)
        is_placed = np.bincount(parts, found[poses]) > 0.0
        align_parts(graph, result, found, parts, is_placed)
    place_points(graph, result, found)
    return result


def _begin_at_priors(
    graph: FactorGraph, values: Values, is_given: dict[VariableKind, Mask]
) -> dict[VariableKind, Mask]:
    """Set values that are not given to those of a prior; return of each kind which, (n,)."""
    result = {kind: np.zeros_like(mask) for kind, mask in is_given.items()}
    for block in blocks_of(graph, PRIOR_2D, PRIOR_3D, PRIOR_POINT_2D, PRIOR_POINT_3D):
        (kind,), (rows,) = block.kind.variables, block.variables
        new = ~is_given[kind][rows] & is_definite(block.information)
        values[kind][rows[new]] = block.measurements[new]
        result[kind][rows[new]] = True
    return result
