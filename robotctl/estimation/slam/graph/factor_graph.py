"""A factor graph: which variables there are, and the factors between them; values stand apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.checks import check_block, check_values
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, Ints
from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats, VariableKind

Values: TypeAlias = dict[VariableKind, Floats]
"""Values of each kind in a graph, (n, size), in the order of its ids."""


@dataclass(frozen=True, slots=True, eq=False)
class FactorGraph:
    """Variables and factors. All variables are numbered through, kind after kind.

    Parameters
    ----------
    ids
        Of each kind, the numbers that people know its variables by, (n,).
    blocks
        The factors.

    Raises
    ------
    ValueError
        If arrays have other shapes than their kinds say, name variables that are not there, or hold
        numbers that cannot be (not finite, a quaternion that is not of length 1, information that
        is not symmetric).
    """

    ids: dict[VariableKind, Ints]
    blocks: tuple[FactorBlock, ...]

    def __post_init__(self) -> None:
        counts = self.counts
        for block in self.blocks:
            check_block(block, counts)

    @property
    def counts(self) -> dict[VariableKind, int]:
        """Number of variables of each kind."""
        return {kind: len(ids) for kind, ids in self.ids.items()}

    @property
    def size(self) -> int:
        """Number of variables."""
        return sum(map(len, self.ids.values()))

    @property
    def factors(self) -> int:
        """Number of factors."""
        return sum(map(len, self.blocks))

    @property
    def poses(self) -> VariableKind | None:
        """Kind of the poses; None if there are none."""
        return next((kind for kind in (SE2, SE3) if len(self.ids.get(kind, ()))), None)

    def first(self, kind: VariableKind) -> int:
        """Return the number of the first variable of a kind."""
        result = 0
        for each, ids in self.ids.items():
            if each is kind:
                break
            result += len(ids)
        return result

    def dof(self) -> Ints:
        """Return the degrees of freedom of each variable, (n,)."""
        counts = list(map(len, self.ids.values()))
        return np.repeat(np.array([kind.dof for kind in self.ids], np.int64), counts)

    def numbers(self, block: FactorBlock) -> tuple[Ints, ...]:
        """Return the numbers of the variables of each factor of a block, each (n,)."""
        return tuple(
            rows + self.first(kind)
            for rows, kind in zip(block.variables, block.kind.variables, strict=True)
        )

    def place(self, number: int) -> tuple[VariableKind, int]:
        """Return the kind of a variable, and its row among those of that kind."""
        row = number
        for kind, ids in self.ids.items():
            if row < len(ids):
                return kind, row
            row -= len(ids)
        raise IndexError(number)

    def rows(self, numbers: Ints) -> dict[VariableKind, Ints]:
        """Return of each kind the rows of some variables, in ascending order."""
        chosen = np.zeros(self.size, np.bool_)
        chosen[numbers] = True
        bounds = np.cumsum(list(self.counts.values()))[:-1]
        return {
            kind: np.flatnonzero(mask)
            for kind, mask in zip(self.ids, np.split(chosen, bounds), strict=True)
        }

    def name(self, number: int) -> str:
        """Return what a message calls a variable."""
        kind, row = self.place(number)
        return f"{kind.name} {self.ids[kind][row]}"

    def names(self, numbers: Sequence[int], most: int = 5) -> str:
        """Return what a message calls variables, of many only the first."""
        text = ", ".join(self.name(int(each)) for each in numbers[:most])
        return text if len(numbers) <= most else f"{text} and {len(numbers) - most} more"

    def components(self, apart: Ints | Sequence[int] = ()) -> Ints:
        """Return for each variable the number of its connected component, (n,), from 0.

        Factors without information connect nothing.

        Parameters
        ----------
        apart
            Numbers of variables that do not connect others: each is a component of its own.
        """
        parent = np.arange(self.size)
        connects = np.ones(self.size, np.bool_)
        connects[np.asarray(apart, np.int64)] = False
        for a, b in self.pairs(informed=True):
            both = connects[a] & connects[b]
            first, second = a[both], b[both]
            # Each root takes the smallest root that it meets, until none changes any more.
            while True:
                low = np.minimum(parent[first], parent[second])
                before = parent.copy()
                np.minimum.at(parent, parent[first], low)
                np.minimum.at(parent, parent[second], low)
                parent = parent[parent]
                if np.array_equal(parent, before):
                    break
        while not np.array_equal(parent, parent[parent]):
            parent = parent[parent]
        return np.unique(parent, return_inverse=True)[1]

    def pairs(self, *, informed: bool = False) -> Iterator[tuple[Ints, Ints]]:
        """Yield all pairs of variables with a common factor, (m,) and (m,), at once.

        With `informed` only those whose factor has information.
        """
        pairs = [
            pair
            for each in self.blocks
            if len(each.kind.variables) > 1
            for pair in combinations(self.numbers(each.informed() if informed else each), 2)
        ]
        if pairs:
            yield np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


def chi2_of(graph: FactorGraph, values: Values) -> float:
    """Return the sum of r^T Omega r over all factors: chi2 as g2o reports it.

    Raises
    ------
    ValueError
        If values have other shapes than the variables of the graph.
    """
    check_values(graph.counts, values, numbers=False)
    total = 0.0
    for block in graph.blocks:
        r = block.kind.residual(*values_of(block, values), block.measurements)
        total += float(np.einsum("ni,nij,nj->", r, block.information, r))
    return total


def values_of(block: FactorBlock, values: Values) -> tuple[Floats, ...]:
    """Return the values of the variables of a block, each (n, size of its kind)."""
    return tuple(
        values[kind][rows] for kind, rows in zip(block.kind.variables, block.variables, strict=True)
    )


def blocks_of(graph: FactorGraph, *kinds: FactorKind) -> list[FactorBlock]:
    """Return the blocks of some kinds."""
    return [block for block in graph.blocks if block.kind in kinds]


def chosen(graph: FactorGraph, masks: Sequence[NDArray[np.bool_]]) -> FactorGraph:
    """Return a graph with some of the factors: a mask for each block."""
    blocks = tuple(block.take(mask) for block, mask in zip(graph.blocks, masks, strict=True))
    return FactorGraph(graph.ids, tuple(block for block in blocks if len(block)))
