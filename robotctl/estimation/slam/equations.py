"""The normal equations of a factor graph: ordered and analysed once, then filled and solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.graph.checks import check_values
from robotctl.estimation.slam.graph.factor import FactorBlock, Ints, Linearised
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, values_of
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.linear.assembly import (
    assemble_many,
    pair_assembler,
    quadratic_forms,
    single_assembler,
)
from robotctl.estimation.slam.linear.cholesky import (
    factorise,
    multiply,
    solve_lower,
    solve_upper,
)
from robotctl.estimation.slam.linear.ordering import minimum_degree
from robotctl.estimation.slam.linear.symbolic import Symbolic, analyse, locate


class GraphError(RobotctlError):
    """A graph has no solution, or no single one; the message names variables."""


@dataclass(slots=True, eq=False)
class Linearisation:
    """All factors about one set of values.

    Parameters
    ----------
    values
        The point.
    blocks
        Residuals and Jacobians of each block.
    squares
        r^T Omega r of the factors of each block, (n,).
    """

    values: Values
    blocks: list[Linearised]
    squares: list[Floats]

    @property
    def chi2(self) -> float:
        """The sum over all factors."""
        return float(sum(each.sum() for each in self.squares))


class Equations(Protocol):
    """H d = -g, as solvers need it; more on each part in `NormalEquations`."""

    @property
    def gradient(self) -> Floats:
        """The vector g."""
        ...

    def linearise(self, values: Values, into: Linearisation | None = None) -> Linearisation:
        """Return all factors about values."""
        ...

    def assemble(self, at: Linearisation, weights: Sequence[Floats] | None = None) -> None:
        """Fill matrix and gradient."""
        ...

    def factorise(self, damping: Floats | None = None) -> int | None:
        """Prepare to solve; return the number of a variable where that failed."""
        ...

    def solve(self) -> Floats:
        """Return the increments."""
        ...

    def product(self, x: Floats) -> Floats:
        """Return the matrix times x."""
        ...

    def retract(self, values: Values, increments: Floats) -> Values:
        """Return values moved by increments."""
        ...

    @property
    def diagonal(self) -> Floats:
        """The diagonal of the matrix."""
        ...


def linearise(
    graph: FactorGraph, values: Values, into: Linearisation | None = None
) -> Linearisation:
    """Return all factors about `values`, in the space of an earlier linearisation if given.

    Raises
    ------
    ValueError
        If values have other shapes than the variables of the graph.
    """
    check_values(graph.counts, values, numbers=False)
    blocks = into.blocks if into else [Linearised.empty(block) for block in graph.blocks]
    squares = []
    for block, linearised in zip(graph.blocks, blocks, strict=True):
        linearised.fill(block, values_of(block, values))
        squares.append(quadratic_forms(linearised.residuals, block.information))
    return Linearisation(values, blocks, squares)


class NormalEquations:
    """H d = -g for the increments d of all variables that are not fixed.

    Parameters
    ----------
    graph
        What is to be solved.
    fixed
        Numbers of the variables that keep their values: the gauge.
    last
        Numbers of variables to be eliminated last.
    """

    def __init__(
        self, graph: FactorGraph, fixed: Sequence[int] | Ints, last: Sequence[int] | Ints = ()
    ) -> None:
        self.graph = graph
        size = graph.size
        is_free = np.ones(size, np.bool_)
        is_free[np.asarray(fixed, np.int64)] = False
        self.variables = np.flatnonzero(is_free)
        dof = graph.dof()
        free = np.full(size, -1, np.int64)
        free[self.variables] = np.arange(len(self.variables))
        is_last = np.zeros(size, np.bool_)
        is_last[np.asarray(last, np.int64)] = True
        starts, neighbours = adjacency(
            len(self.variables), [(free[a], free[b]) for a, b in graph.pairs()]
        )
        widths = dof[self.variables]
        order = minimum_degree(starts, neighbours, widths, is_last[self.variables])
        self.symbolic: Symbolic = analyse(starts, neighbours, order, widths)
        position = np.empty(len(order), np.int64)
        position[self.symbolic.order] = np.arange(len(order))
        self.position = np.full(size, -1, np.int64)
        self.position[self.variables] = position
        self.columns = np.full(size, -1, np.int64)
        """First column of each variable; -1 if it is fixed."""
        self.columns[self.variables] = self.symbolic.scalars[position]
        self.total = int(self.symbolic.scalars[-1])
        self._maps = [self._map(block) for block in graph.blocks]
        entries = int(self.symbolic.panel_starts[-1])
        self.matrix, self.factor = np.zeros(entries), np.empty(entries)
        self.gradient = np.zeros(self.total)
        self._stack = np.empty(self.symbolic.stack_size)
        self._diagonal = self._diagonal_places()
        self._targets = {
            kind: self._columns_of(graph.first(kind), len(ids), kind.dof)
            for kind, ids in graph.ids.items()
        }

    def _columns_of(self, first: int, count: int, dof: int) -> Ints:
        """Return the columns of variables, (n, dof); those of fixed ones are the column behind."""
        columns = self.columns[first : first + count]
        return np.where(
            columns[:, None] < 0, self.total, columns[:, None] + np.arange(dof, dtype=np.int64)
        )

    def _diagonal_places(self) -> Ints:
        at = np.arange(len(self.symbolic.order))
        places, strides = locate(self.symbolic, at, at)
        widths = np.diff(self.symbolic.scalars)
        within = np.arange(self.total) - np.repeat(self.symbolic.scalars[:-1], widths)
        result: Ints = np.repeat(places, widths) + within * (np.repeat(strides, widths) + 1)
        return result

    def _map(self, block: FactorBlock) -> tuple[Ints, Ints]:
        """Return places in the matrix as the assemblers need them, and columns, (n, variables)."""
        if not len(self.variables):
            count = len(block.variables)
            shape = len(block), {1: 2, 2: 7}.get(count, 3 * count * (count + 1) // 2)
            return np.full(shape, -1, np.int64), np.full((len(block), count), -1)
        numbers = self.graph.numbers(block)
        positions = [self.position[each] for each in numbers]
        columns = np.column_stack([self.columns[each] for each in numbers])
        places: list[Ints] = []
        if len(positions) > 2:
            for a, b in combinations_with_replacement(positions, 2):
                places += self._block_place(a, b)
            return np.ascontiguousarray(np.column_stack(places)), np.ascontiguousarray(columns)
        for at in positions:
            safe = np.maximum(at, 0)
            place, stride = locate(self.symbolic, safe, safe)
            places += [np.where(at < 0, -1, place), stride]
        if len(positions) == 2:
            places += self._block_place(*positions)
        return np.ascontiguousarray(np.column_stack(places)), np.ascontiguousarray(columns)

    def _block_place(self, a: Ints, b: Ints) -> tuple[Ints, Ints, Ints]:
        """Return places (-1: one is fixed) and strides of blocks, and whether a comes after b."""
        both = (a >= 0) & (b >= 0)
        low = np.where(both, np.minimum(a, b), 0)
        high = np.where(both, np.maximum(a, b), 0)
        place, stride = locate(self.symbolic, high, low)
        return np.where(both, place, -1), stride, (a > b).astype(np.int64)

    def linearise(self, values: Values, into: Linearisation | None = None) -> Linearisation:
        """Return all factors about `values`, in the space of an earlier linearisation if given."""
        return linearise(self.graph, values, into)

    def assemble(self, at: Linearisation, weights: Sequence[Floats] | None = None) -> None:
        """Fill matrix and gradient; `weights` are factors on the information, (n,) a block."""
        self.matrix[:] = 0.0
        self.gradient[:] = 0.0
        for index, (block, linearised, (places, columns)) in enumerate(
            zip(self.graph.blocks, at.blocks, self._maps, strict=True)
        ):
            kind = block.kind
            ones = np.ones(len(block)) if weights is None else weights[index]
            if len(kind.variables) > 2:
                assemble_many(
                    linearised.residuals, np.concatenate(linearised.jacobians, axis=2),
                    np.cumsum([0, *(each.dof for each in kind.variables)]), block.information,
                    ones, places, columns, self.matrix, self.gradient,
                )  # fmt: skip
                continue
            assembler = pair_assembler if len(kind.variables) == 2 else single_assembler
            assembler(kind.size, *(each.dof for each in kind.variables))(
                linearised.residuals,
                *linearised.jacobians,
                block.information,
                ones,
                places,
                columns,
                self.matrix,
                self.gradient,
            )

    def factorise(self, damping: Floats | None = None) -> int | None:
        """Factor the matrix, plus `damping` (columns,) on its diagonal.

        Returns
        -------
        int or None
            None if it is positive definite; else the number of the variable where that ended.
        """
        np.copyto(self.factor, self.matrix)
        if damping is not None:
            self.factor[self._diagonal] += damping
        failed = factorise(self.symbolic, self.factor, self._stack)
        return None if failed < 0 else self.variable_at(failed)

    def variable_at(self, column: int) -> int:
        """Return the number of the variable that a column belongs to."""
        position = int(np.searchsorted(self.symbolic.scalars, column, "right")) - 1
        return int(self.variables[self.symbolic.order[position]])

    def solve(self, right: Floats | None = None) -> Floats:
        """Return the solution for a right side, (columns,); by default that of least squares."""
        x = -self.gradient if right is None else right.copy()
        solve_lower(self.symbolic, self.factor, x)
        solve_upper(self.symbolic, self.factor, x)
        return x

    def product(self, x: Floats) -> Floats:
        """Return the matrix times x, (columns,)."""
        return multiply(self.symbolic, self.matrix, x)

    @property
    def diagonal(self) -> Floats:
        """The diagonal of the matrix, (columns,)."""
        result: Floats = self.matrix[self._diagonal]
        return result

    def retract(self, values: Values, increments: Floats) -> Values:
        """Return values moved by increments, (columns,)."""
        padded = np.append(increments, 0.0)
        return {
            kind: kind.retract(values[kind], padded[self._targets[kind]]) for kind in self.graph.ids
        }


def adjacency(n: int, pairs: Sequence[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    """Return the neighbours of each of n variables: where they begin, (n + 1,), and all of them.

    Pairs with a negative number, and loops, are left out.
    """
    codes = [np.empty(0, np.int64)]
    for a, b in pairs:
        good = (a >= 0) & (b >= 0) & (a != b)
        codes += [a[good] * n + b[good], b[good] * n + a[good]]
    unique: NDArray[np.int64] = np.unique(np.concatenate(codes))
    starts = np.searchsorted(unique, np.arange(n + 1, dtype=np.int64) * n)
    return starts.astype(np.int64), unique % max(n, 1)
