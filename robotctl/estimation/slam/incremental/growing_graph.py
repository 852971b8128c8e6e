"""A graph that grows, with its factors linearised, where its variables were last.

The estimate of a variable is the value at which its factors are linearised, and an increment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.grown import Grown
from robotctl.estimation.slam.graph.checks import check_numbers, check_values
from robotctl.estimation.slam.graph.factor import FactorKind, Ints
from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import Floats, VariableKind
from robotctl.estimation.slam.incremental.bayes_tree import Links
from robotctl.estimation.slam.incremental.factor_table import FactorTable
from robotctl.estimation.slam.linear.assembly import quadratic_forms
from robotctl.estimation.slam.robust.robust_cost import scale

_FIXED: Final = -1


class _Variables:
    """All variables of one kind: their values, their numbers and their columns."""

    def __init__(self, kind: VariableKind) -> None:
        self.values = Grown((kind.size,), float)
        self.numbers = Grown((), np.int64)
        self.columns = Grown((kind.dof,), np.int64)


class Pending:
    """Changes that the next update takes in."""

    def __init__(self) -> None:
        self.touched: list[int] = []
        """Variables whose factors have changed."""
        self.new: list[int] = []
        """Variables that no clique holds."""
        self.factors: list[int] = []
        """Factors to linearise."""
        self.only_new = True
        """Whether none of these was there before."""


class GrowingGraph:
    """Variables and factors, added one by one.

    Variables have the numbers in which they are added, from 0; so have factors.
    """

    def __init__(self) -> None:
        self._kinds: list[VariableKind] = []
        self._rows: list[int] = []
        self._variables: dict[VariableKind, _Variables] = {}
        self._blocks: dict[tuple[FactorKind, RobustKernel | None], int] = {}
        self._factors: list[FactorTable] = []
        self._block_of, self._row_of = Grown((), np.int32), Grown((), np.int32)
        self._offsets, self._dof = Grown((), np.int64), Grown((), np.int64)
        self._owner, self._increments = Grown((), np.int64), Grown((), float)
        self._clique_of, self._heads = Grown((), np.int64), Grown((), np.int64)
        self._begins, self._ends = Grown((), np.int64), Grown((), np.int64)
        self._begins.add((0,))
        self._factor_of = Grown((), np.int64)
        self._places, self._terms = Grown((), np.int64), Grown((), float)
        self._following = Grown((), np.int64)
        self._pending = Pending()

    def variable(self, kind: VariableKind, value: Floats, *, fixed: bool = False) -> int:
        """Add a variable at a value (size,), perhaps one that keeps it; return its number.

        Raises
        ------
        ValueError
            If the value has another shape, or is none.
        """
        check_values({kind: 1}, {kind: value[None]}, numbers=True)
        number = len(self._kinds)
        self._kinds.append(kind)
        own = self._variables.setdefault(kind, _Variables(kind))
        self._rows.append(own.values.add(value[None]))
        width = 0 if fixed else kind.dof
        begin = self._increments.size
        self._offsets.add((begin,))
        self._dof.add((width,))
        self._owner.add(np.full(width, number))
        self._increments.add(np.zeros(width))
        columns = np.full(kind.dof, _FIXED) if fixed else np.arange(begin, begin + width)
        own.columns.add(columns[None])
        own.numbers.add((number,))
        self._clique_of.add((-1,))
        self._heads.add((-1,))
        if not fixed:
            self._pending.new.append(number)
            self._pending.touched.append(number)
        return number

    def factor(
        self, kind: FactorKind, variables: Sequence[int], measurement: Floats, information: Floats,
        kernel: RobustKernel | None = None,
    ) -> int:  # fmt: skip
        """Add a factor on variables; return its number. Arrays of one row of a `FactorBlock`.

        The weight that a robust kernel gives it is renewed whenever it is linearised.

        Raises
        ------
        ValueError
            If there are no such variables of the factor's kinds, or an array has another shape or
            a number that cannot be.
        """
        self.check_ends(kind, variables)
        check_numbers(kind, measurement[None], information[None])
        number = self._block_of.size
        block = self._blocks.setdefault((kind, kernel), len(self._factors))
        if block == len(self._factors):
            self._factors.append(FactorTable(kind, kernel))
        own = self._factors[block]
        self._block_of.add((block,))
        self._row_of.add((own.variables.add([[self._rows[each] for each in variables]]),))
        own.measurements.add(measurement[None])
        own.information.add(information[None])
        own.numbers.add((number,))
        own.weights.add((1.0,))
        free = [each for each in variables if self._dof.array[each]]
        width = int(sum(self._dof.array[each] for each in free))
        self._places.add((self._terms.add(np.zeros(width * width + width)),))
        entry = self._ends.add(np.array(free, np.int64))
        self._factor_of.add(np.full(len(free), number))
        self._following.add(self._heads.array[np.array(free, np.int64)])
        self._heads.array[free] = np.arange(entry, entry + len(free))
        self._begins.add((self._ends.size,))
        self._pending.touched += free
        self._pending.factors.append(number)
        return number

    def check_ends(self, kind: FactorKind, variables: Sequence[int]) -> None:
        """Refuse variables that are not there, or not of the kinds that a factor links.

        Raises
        ------
        ValueError
            With what was found, and what is needed.
        """
        found = [self._kinds[each] for each in variables if 0 <= each < len(self._kinds)]
        if tuple(found) != kind.variables or len(set(variables)) != len(variables):
            raise ValueError(
                f"factor {kind.name!r} of variables {tuple(variables)}: "
                f"{', '.join(repr(each) for each in found)} found, "
                f"{', '.join(repr(each) for each in kind.variables)} needed"
            )

    def weigh(self, factor: int, weight: float) -> None:
        """Change the weight of a factor from the next update on; 0 removes it."""
        own = self._factors[self._block_of.array[factor]]
        own.weights.array[self._row_of.array[factor]] = weight
        self._pending.factors.append(factor)
        self._pending.only_new = False
        begin, end = self._begins.array[factor : factor + 2]
        self._pending.touched += self._ends.array[begin:end].tolist()

    def remove(self, factor: int) -> None:
        """Take a factor out again, from the next update on."""
        self.weigh(factor, 0.0)

    def _links(self) -> Links:
        """Return the graph as a Bayes tree takes it."""
        return Links(
            self._offsets.view, self._dof.view, self._owner.view, self._begins.view,
            self._ends.view, self._factor_of.view, self._places.view, self._terms.view,
            self._heads.view, self._following.view,
        )  # fmt: skip

    def _move(self, beyond: float) -> None:
        """Move points of linearisation to the estimate, where an increment is larger."""
        increments = self._increments.view
        large = np.flatnonzero(np.abs(increments) > beyond)
        if len(large) == 0:
            return
        moved = np.unique(self._owner.view[large])
        for kind, own in self._variables.items():
            rows = np.flatnonzero(np.isin(own.numbers.view, moved))
            if len(rows) == 0:
                continue
            columns = own.columns.array[rows]
            values = own.values.array
            values[rows] = kind.retract(values[rows], increments[columns])
            increments[columns] = 0.0
        factors, neighbours = _around(
            moved, self._heads.view, self._following.view, self._begins.view, self._ends.view,
            self._factor_of.view,
        )  # fmt: skip
        self._pending.factors += factors.tolist()
        self._pending.only_new = False
        self._pending.touched += moved.tolist() + neighbours.tolist()

    def _linearise(self, factors: Ints) -> None:
        """Renew matrix and gradient of some factors."""
        for own in self._factors:
            rows = (
                np.flatnonzero(np.isin(own.numbers.view, factors))
                if len(self._factors) > 1
                else factors
            )
            if len(rows) == 0:
                continue
            block = own.block(rows)
            linked = [self._variables[each] for each in own.kind.variables]
            is_free = np.column_stack(
                [
                    self._dof.array[each.numbers.array[mine]] > 0
                    for each, mine in zip(linked, block.variables, strict=True)
                ]
            )
            values = tuple(
                each.values.array[mine] for each, mine in zip(linked, block.variables, strict=True)
            )
            own.linearise(
                rows, block, values, is_free, self._places.array[own.numbers.array[rows]],
                self._terms.array,
            )  # fmt: skip

    def estimates(self, kind: VariableKind) -> Floats:
        """Return the present values of all variables of a kind, (n, size), as they were added."""
        own, padded = self._variables[kind], np.append(self._increments.view, 0.0)
        return kind.retract(own.values.view, padded[own.columns.view])

    def row(self, number: int) -> int:
        """Return which row a variable is among those of its kind."""
        return self._rows[number]

    def estimates_of(self, kind: VariableKind, rows: Ints) -> Floats:
        """Return the present values of some variables of a kind, by their rows, (m, size)."""
        own, padded = self._variables[kind], np.append(self._increments.view, 0.0)
        return kind.retract(own.values.array[rows], padded[own.columns.array[rows]])

    def chi2(self) -> float:
        """Return the cost of all factors, by their weights: r^T Omega r, or what kernels make."""
        total = 0.0
        for own in self._factors:
            values = [
                self.estimates(each)[rows]
                for each, rows in zip(own.kind.variables, own.variables.view.T, strict=True)
            ]
            r = own.kind.residual(*values, own.measurements.view)
            squares = quadratic_forms(np.ascontiguousarray(r), own.information.view)
            if own.kernel is not None:
                squares = own.kernel.cost(squares, scale(own.kind.size))
            total += float(own.weights.view @ squares)
        return total

    def estimate(self, number: int) -> Floats:
        """Return the present value of a variable, (size,)."""
        kind, row = self._kinds[number], self._rows[number]
        own = self._variables[kind]
        columns = own.columns.array[row]
        step = np.where(columns >= 0, self._increments.array[columns], 0.0)
        result: Floats = kind.retract(own.values.array[row : row + 1], step[None])[0]
        return result


@compiled
def _around(
    moved: Ints, heads: Ints, following: Ints, begins: Ints, ends: Ints, factor_of: Ints
) -> tuple[Ints, Ints]:
    """Return the factors of some variables, and the variables that these link."""
    count, reached = 0, 0
    for v in moved:
        entry = heads[v]
        while entry >= 0:
            count += 1
            reached += begins[factor_of[entry] + 1] - begins[factor_of[entry]]
            entry = following[entry]
    factors, others, at, to = np.empty(count, np.int64), np.empty(reached, np.int64), 0, 0
    for v in moved:
        entry = heads[v]
        while entry >= 0:
            factor = factor_of[entry]
            factors[at] = factor
            at += 1
            for other in range(begins[factor], begins[factor + 1]):
                others[to] = ends[other]
                to += 1
            entry = following[entry]
    return factors, others
