"""Directions in which priors and fixed variables leave a component free, and priors that hold them.

Factors between variables say nothing of where a component lies as a whole: it can move by a twist
of the world, three numbers in the plane and six in space. Each prior, position or fixed variable
takes some of that freedom: one position leaves the heading, two in space a turn about the line
through them. What is left changes no residual, so a prior on just that changes no optimum; it only
chooses one of the many that are alike. Where nothing is known at all, `gauge` fixes a whole pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import qr  # type: ignore[import-untyped]

from robotctl.estimation.slam.factors.prior import PRIOR_2D, PRIOR_3D
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, Ints, Linearised
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, values_of
from robotctl.estimation.slam.graph.variables import LARGEST, SE2, SE3, Floats, VariableKind
from robotctl.estimation.slam.start.twists import twist_increments

_PRIORS: Final[dict[VariableKind, FactorKind]] = {SE2: PRIOR_2D, SE3: PRIOR_3D}
_COORDINATES: Final[dict[VariableKind, tuple[str, ...]]] = {
    SE2: ("x", "y", "rotation"),
    SE3: ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z"),
}
_FREE: Final = 1e-10
"""Share of the best known direction below which one counts as unknown; of squares."""
_STRENGTH: Final = 1e6
"""Information of an anchor, as a multiple of the largest in the graph."""
_ROTATION_FIRST: Final = 10.0
"""Preference for holding a rotation where a shift could be held as well."""


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """A prior on some coordinates of a variable.

    Parameters
    ----------
    number
        Number of the variable.
    coordinates
        Indices among its increments.
    """

    number: int
    coordinates: tuple[int, ...]

    def name(self, graph: FactorGraph) -> str:
        """Return what a report calls it."""
        kind, _ = graph.place(self.number)
        words = ", ".join(_COORDINATES[kind][each] for each in self.coordinates)
        return f"{graph.name(self.number)}: {words}"


def outer_factors(graph: FactorGraph, fixed: Ints) -> Iterator[tuple[FactorBlock, int]]:
    """Yield the factors that say where one free variable is in the world, and its slot.

    They have information, and no other variable that is free.
    """
    is_free = np.ones(graph.size, np.bool_)
    is_free[fixed] = False
    for block in graph.blocks:
        free = np.column_stack([is_free[each] for each in graph.numbers(block)])
        for slot in range(free.shape[1]):
            own = block.take(free[:, slot] & (free.sum(axis=1) == 1)).informed()
            if len(own):
                yield own, slot


def anchors(graph: FactorGraph, values: Values, fixed: Ints) -> list[Anchor]:
    """Return what holds the directions in which components with poses can move freely.

    Parameters
    ----------
    graph, values
        The graph, and where its variables are.
    fixed
        Numbers of the variables that keep their values, `gauge` among them.
    """
    kind = graph.poses
    if kind is None:
        return []
    component = graph.components(fixed)
    first, count = graph.first(kind), graph.counts[kind]
    names, firsts = np.unique(component[first : first + count], return_index=True)
    row_of = np.full(graph.size, -1, np.int64)
    row_of[names] = firsts
    size = int(component.max()) + 1
    centres, information = _known_of(graph, values, fixed, component, size)
    # A component without such factors is a fixed variable.
    chosen = np.flatnonzero((row_of[:size] >= 0) & np.any(information, axis=(1, 2)))
    scale = np.sqrt(np.maximum(np.diagonal(information[chosen], axis1=1, axis2=2), 1e-300))
    scaled = information[chosen] / (scale[:, :, None] * scale[:, None, :])
    squares, directions = np.linalg.eigh(scaled)
    result = []
    for at in np.flatnonzero(squares[:, 0] <= _FREE * squares[:, -1]).tolist():
        row = int(row_of[chosen[at]])
        free = squares[at] <= _FREE * squares[at, -1]
        twists = directions[at][:, free] / scale[at][:, None]
        moves = twist_increments(kind, values[kind][row : row + 1], centres[chosen[at]])[0] @ twists
        result.append(Anchor(first + row, _coordinates(kind, moves)))
    return result


def _known_of(
    graph: FactorGraph, values: Values, fixed: Ints, component: Ints, size: int
) -> tuple[Floats, Floats]:
    """Return of each component a centre (size, d), and how well twists about it are known.

    That is the information (size, k, k) of the outer factors, each divided by its largest entry:
    what is known badly is known.
    """
    d = graph.poses.positions if graph.poses is not None else 2
    outer = [
        (block, slot)
        for block, slot in outer_factors(graph, fixed)
        if block.kind.variables[slot].positions == d
    ]
    centres, counts = np.zeros((size, d)), np.zeros(size)
    ends = [component[graph.numbers(block)[slot]] for block, slot in outer]
    own = [values_of(block, values)[slot] for block, slot in outer]
    for at, each in zip(ends, own, strict=True):
        np.add.at(centres, at, each[:, :d])
        np.add.at(counts, at, 1.0)
    centres /= np.maximum(counts, 1.0)[:, None]
    result = np.zeros((size, d * (d + 1) // 2, d * (d + 1) // 2))
    for (block, slot), at, each in zip(outer, ends, own, strict=True):
        linearised = Linearised.empty(block)
        linearised.fill(block, values_of(block, values))
        kind = block.kind.variables[slot]
        J = linearised.jacobians[slot] @ twist_increments(kind, each, centres[at])
        largest = np.abs(block.information).max(axis=(1, 2))
        W = block.information / largest[:, None, None]
        np.add.at(result, at, J.transpose(0, 2, 1) @ W @ J)
    return centres, result


def _coordinates(kind: VariableKind, moves: Floats) -> tuple[int, ...]:
    """Return which increments of a pose to hold, so that none of some moves (dof, m) is left."""
    weights = np.where(np.arange(kind.dof) < kind.positions, 1.0, _ROTATION_FIRST)
    moves = moves / np.linalg.norm(moves, axis=0)
    _, _, order = qr((weights[:, None] * moves).T, mode="economic", pivoting=True)
    return tuple(sorted(order[: moves.shape[1]].tolist()))


def anchored(graph: FactorGraph, values: Values, held: Sequence[Anchor]) -> FactorGraph:
    """Return a graph with a strong prior on what anchors hold, at the values; those come last."""
    if not held:
        return graph
    kind, _ = graph.place(held[0].number)
    most = max(float(each.information.max(initial=0.0)) for each in graph.blocks)
    rows = np.array([graph.place(each.number)[1] for each in held])
    information = np.zeros((len(held), kind.dof, kind.dof))
    for own, anchor in zip(information, held, strict=True):
        own[anchor.coordinates, anchor.coordinates] = min(_STRENGTH * most, LARGEST)
    block = FactorBlock(_PRIORS[kind], (rows,), values[kind][rows], information)
    return FactorGraph(graph.ids, (*graph.blocks, block))
