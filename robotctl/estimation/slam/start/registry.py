"""The starts by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.factors.prior import PRIOR_2D, PRIOR_3D
from robotctl.estimation.slam.graph.factor import Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, blocks_of
from robotctl.estimation.slam.graph.variables import Floats, VariableKind
from robotctl.estimation.slam.start.chordal import chordal_poses
from robotctl.estimation.slam.start.points import place_points
from robotctl.estimation.slam.start.spanning import relative_poses, tree_poses

Mask = NDArray[np.bool_]


def _file(_: FactorGraph, poses: Floats, tree: Floats, known: Mask, _fixed: Ints) -> Floats:
    return np.where(known[:, None], poses, tree)


def _odometry(_: FactorGraph, _poses: Floats, tree: Floats, _known: Mask, _fixed: Ints) -> Floats:
    return tree


def _tree(graph: FactorGraph, poses: Floats, _tree: Floats, known: Mask, _fixed: Ints) -> Floats:
    return tree_poses(graph, poses, known, by_odometry=False)


def _chordal(graph: FactorGraph, _: Floats, tree: Floats, _known: Mask, fixed: Ints) -> Floats:
    if len(relative_poses(graph)[0]) == 0:
        return tree
    return chordal_poses(graph, tree, fixed)


STARTS: Final[dict[str, Callable[[FactorGraph, Floats, Floats, Mask, Ints], Floats]]] = {
    "file": _file,
    "odometry": _odometry,
    "tree": _tree,
    "chordal": _chordal,
}
"""How poses begin: of a graph, its values, those along its odometry, which are given, and which
are fixed."""


def start_values(
    graph: FactorGraph, values: Values, known: dict[VariableKind, Mask], fixed: Ints, name: str
) -> Values:
    """Return values to begin at.

    Parameters
    ----------
    graph, values, known
        As read: values that are not known are placeholders.
    fixed
        Numbers of the fixed variables; they keep values that are known.
    name
        One of `STARTS`. Points follow from the poses, but from the file those that it has.
    """
    result = {kind: each.copy() for kind, each in values.items()}
    poses = graph.poses
    found: dict[object, Mask] = {
        kind: np.zeros(len(ids), np.bool_) for kind, ids in graph.ids.items()
    }
    if poses is not None:
        first, count = graph.first(poses), len(graph.ids[poses])
        rows = fixed[(fixed >= first) & (fixed < first + count)] - first
        good = np.zeros(count, np.bool_)
        good[rows] = True
        begin = result[poses]
        for block in blocks_of(graph, PRIOR_2D, PRIOR_3D):
            begin[block.variables[0]] = block.measurements
            good[block.variables[0]] = True
        tree = tree_poses(graph, begin, good, by_odometry=True)
        result[poses] = STARTS[name](
            graph, begin, tree, known[poses] if name == "file" else good, rows
        )
    for kind in graph.ids:
        if not kind.is_pose and (name == "file" or poses is None):
            found[kind] |= known[kind]
    place_points(graph, result, found)
    return result
