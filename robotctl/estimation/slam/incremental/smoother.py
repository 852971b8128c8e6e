"""Incremental smoothing on any factors: add, remove, and have the estimate after each step.

Variables far from where they were linearised are linearised anew (fluid relinearisation), and only
increments that change are passed on (the wildfire threshold), as in iSAM2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.grown import Grown
from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.graph.checks import check_numbers, check_values
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, Ints, Linearised
from robotctl.estimation.slam.graph.variables import Floats, VariableKind
from robotctl.estimation.slam.incremental.bayes_tree import (
    Cliques,
    Links,
    compact,
    solve_down,
)
from robotctl.estimation.slam.incremental.renewal import renew
from robotctl.estimation.slam.incremental.uncertainty import projected_covariance

_FIXED: Final = -1
_EXACT: Final = 1e-4
_WASTE: Final = 200_000
"""Numbers of cliques that are gone which are kept before memory is cleared."""


@dataclass(frozen=True, slots=True)
class SmootherConfig:
    """How exact the estimate is.

    Parameters
    ----------
    relinearise
        Increments beyond which a variable is linearised anew [m, rad].
    wildfire
        Changes of increments that are not passed on [m, rad].
    """

    relinearise: float = 0.1
    wildfire: float = 1e-3


@compiled
def _terms(  # noqa: C901 - one compiled loop
    residuals: Floats, by_a: Floats, by_b: Floats, information: Floats, weights: Floats,
    places: Ints, has_a: NDArray[np.bool_], has_b: NDArray[np.bool_], terms: Floats,
) -> None:  # fmt: skip
    """Write matrix and gradient of factors (n,) over those of their variables that are free."""
    size = residuals.shape[1]
    da, db = by_a.shape[2], by_b.shape[2]
    J = np.empty((size, da + db))
    for k in range(len(residuals)):
        width = 0
        if has_a[k]:
            for i in range(size):
                for j in range(da):
                    J[i, j] = by_a[k, i, j]
            width = da
        if has_b[k]:
            for i in range(size):
                for j in range(db):
                    J[i, width + j] = by_b[k, i, j]
            width += db
        at = places[k]
        for j in range(width):
            gradient = 0.0
            for m in range(width):
                terms[at + j * width + m] = 0.0
            for i in range(size):
                weighted = 0.0
                for m in range(size):
                    weighted += information[k, i, m] * J[m, j]
                weighted *= weights[k]
                gradient += weighted * residuals[k, i]
                for m in range(width):
                    terms[at + j * width + m] += weighted * J[i, m]
            terms[at + width * width + j] = gradient


class _Kind:
    """All factors of one kind, with what linearising them needs."""

    def __init__(self, kind: FactorKind) -> None:
        self.kind = kind
        self.variables = Grown((len(kind.variables),), np.int64)
        self.measurements = Grown((kind.measurement,), float)
        self.information = Grown((kind.size, kind.size), float)
        self.numbers = Grown((), np.int64)
        self.weights = Grown((), float)


class _Variables:
    """All variables of one kind: their values, their numbers and their columns."""

    def __init__(self, kind: VariableKind) -> None:
        self.values = Grown((kind.size,), float)
        self.numbers = Grown((), np.int64)
        self.columns = Grown((kind.dof,), np.int64)


class _Pending:
    """Changes that the next update takes in."""

    def __init__(self) -> None:
        self.touched: list[int] = []
        """Variables whose factors have changed."""
        self.new: list[int] = []
        """Variables that no clique holds."""
        self.factors: list[int] = []
        """Factors to linearise."""


class IncrementalSmoother:
    """The estimate of a graph that grows.

    Variables have the numbers in which they are added, from 0; so have factors.
    """

    def __init__(self, config: SmootherConfig | None = None) -> None:
        self.config = config or SmootherConfig()
        self._kinds: list[VariableKind] = []
        self._rows: list[int] = []
        self._variables: dict[VariableKind, _Variables] = {}
        self._blocks: dict[FactorKind, _Kind] = {}
        self._block_of: list[tuple[_Kind, int]] = []
        self._offsets, self._dof = Grown((), np.int64), Grown((), np.int64)
        self._owner, self._increments = Grown((), np.int64), Grown((), float)
        self._clique_of, self._heads = Grown((), np.int64), Grown((), np.int64)
        self._first, self._second = Grown((), np.int64), Grown((), np.int64)
        self._places, self._terms = Grown((), np.int64), Grown((), float)
        self._following = Grown((), np.int64)
        empty = np.empty(64, np.int64)
        self._cliques = Cliques(
            empty,
            empty.copy(),
            empty.copy(),
            empty.copy(),
            empty.copy(),
            empty.copy(),
            empty.copy(),
            np.empty(64),
            np.zeros(3, np.int64),
        )
        self._pending = _Pending()

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
        self, kind: FactorKind, variables: Sequence[int], measurement: Floats, information: Floats
    ) -> int:
        """Add a factor on variables; return its number. Arrays of one row of a `FactorBlock`.

        Raises
        ------
        ValueError
            If there are no such variables of the factor's kinds, or an array has another shape or
            a number that cannot be.
        """
        self.check_ends(kind, variables)
        check_numbers(kind, measurement[None], information[None])
        number = self._first.size
        own = self._blocks.setdefault(kind, _Kind(kind))
        rows = [self._rows[each] for each in variables]
        self._block_of.append((own, own.variables.add([rows])))
        own.measurements.add(measurement[None])
        own.information.add(information[None])
        own.numbers.add((number,))
        own.weights.add((1.0,))
        free = [each for each in variables if self._dof.array[each]]
        self._first.add((free[0] if free else -1,))
        self._second.add((free[1] if len(free) > 1 else -1,))
        width = int(sum(self._dof.array[each] for each in free))
        self._places.add((self._terms.add(np.zeros(width * width + width)),))
        entry = self._following.add((-1, -1))
        for slot, each in enumerate(free):
            self._following.array[entry + slot] = self._heads.array[each]
            self._heads.array[each] = entry + slot
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
        own, row = self._block_of[factor]
        own.weights.array[row] = weight
        self._pending.factors.append(factor)
        ends = (int(each.array[factor]) for each in (self._first, self._second))
        self._pending.touched += [each for each in ends if each >= 0]

    def remove(self, factor: int) -> None:
        """Take a factor out again, from the next update on."""
        self.weigh(factor, 0.0)

    def forecast(
        self, kind: FactorKind, variables: Sequence[int], measurement: Floats
    ) -> tuple[Floats, Floats]:
        """Return the residual (size,) that a factor would have, and its covariance J P J^T.

        P is the covariance of the estimate as it was updated last; without the factor's own noise.
        """
        at = Linearised.of_one(kind, tuple(map(self.estimate, variables)), measurement)
        free = [slot for slot, each in enumerate(variables) if self._dof.array[each]]
        numbers = np.array([variables[slot] for slot in free], np.int64)
        starts, widths = self._offsets.array[numbers], self._dof.array[numbers]
        columns = np.concatenate(
            [np.arange(a, a + w) for a, w in zip(starts, widths, strict=True)] or [numbers]
        )
        jacobian = np.hstack([at.jacobians[slot][0] for slot in free] or [np.empty((kind.size, 0))])
        covariance = projected_covariance(
            self._cliques, self._clique_of.view, numbers, columns, np.ascontiguousarray(jacobian),
            self._increments.size,
        )  # fmt: skip
        return at.residuals[0], covariance

    def update(self) -> bool:
        """Take in what was added; return whether anything changed.

        Raises
        ------
        GraphError
            If the values have left all bounds; the smoother is of no use then.
        """
        self._relinearise()
        pending = self._pending
        if not pending.touched:
            return False
        self._linearise(np.unique(np.array(pending.factors, np.int64)))
        links = Links(
            self._offsets.view, self._dof.view, self._owner.view, self._first.view,
            self._second.view, self._places.view, self._terms.view, self._heads.view,
            self._following.view,
        )  # fmt: skip
        is_new = np.zeros(self._dof.size, np.bool_)
        is_new[pending.new] = True
        touched = np.array(pending.touched, np.int64)
        self._cliques, first = renew(self._cliques, links, self._clique_of.view, touched, is_new)
        if first < 0:
            raise GraphError(
                "the smoother's equations have no solution: values have left all bounds; begin "
                "nearer, or use lm"
            )
        solve_down(self._cliques, first, self.config.wildfire, self._increments.view)
        self._pending = _Pending()
        if self._cliques.used[2] > _WASTE and len(self._cliques.pool) > 4 * self._live():
            self.compact()
        return True

    def compact(self) -> None:
        """Give back the memory of cliques that are gone."""
        self._cliques = compact(self._cliques, self._clique_of.view)

    def refine(self, most: int = 10) -> None:
        """Relinearise until nothing changes that matters, in at most so many updates."""
        config, self.config = self.config, SmootherConfig(_EXACT, 0.0)
        for _ in range(most):
            if not self.update():
                break
        self.config = config

    def _live(self) -> int:
        """Return the numbers of all cliques that are there."""
        count = self._cliques.used[0]
        live = self._cliques.parents[:count] != -2
        rows, columns = self._cliques.rows[:count][live], self._cliques.columns[:count][live]
        return int(np.sum(rows * columns + (rows - columns) ** 2))

    def _relinearise(self) -> None:
        """Move the points of linearisation of variables whose increments are large."""
        increments = self._increments.view
        large = np.flatnonzero(np.abs(increments) > self.config.relinearise)
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
            moved, self._heads.view, self._following.view, self._first.view, self._second.view
        )
        self._pending.factors += factors.tolist()
        self._pending.touched += moved.tolist() + neighbours.tolist()

    def _linearise(self, factors: Ints) -> None:
        """Renew matrix and gradient of some factors."""
        for own in self._blocks.values():
            rows = (
                np.flatnonzero(np.isin(own.numbers.view, factors))
                if len(self._blocks) > 1
                else factors
            )
            if len(rows) == 0:
                continue
            kind = own.kind
            variables = own.variables.array[rows]
            block = FactorBlock(
                kind,
                tuple(np.ascontiguousarray(each) for each in variables.T),
                own.measurements.array[rows],
                own.information.array[rows],
            )
            at = Linearised.empty(block)
            values = tuple(
                self._variables[each].values.array[mine]
                for each, mine in zip(kind.variables, block.variables, strict=True)
            )
            at.fill(block, values)
            numbers = own.numbers.array[rows]
            has = [
                self._dof.array[self._variables[each].numbers.array[mine]] > 0
                for each, mine in zip(kind.variables, block.variables, strict=True)
            ]
            by_b = at.jacobians[1] if len(has) == 2 else np.empty((len(rows), kind.size, 0))
            _terms(
                at.residuals, at.jacobians[0], by_b, block.information, own.weights.array[rows],
                self._places.array[numbers], has[0],
                has[1] if len(has) == 2 else np.zeros(len(rows), np.bool_), self._terms.array,
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
        """Return the sum of r^T Omega r of all factors, by their weights, at the estimate."""
        total = 0.0
        for own in self._blocks.values():
            values = [
                self.estimates(each)[rows]
                for each, rows in zip(own.kind.variables, own.variables.view.T, strict=True)
            ]
            r = own.kind.residual(*values, own.measurements.view)
            total += float(np.einsum("n,ni,nij,nj->", own.weights.view, r, own.information.view, r))
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
    moved: Ints, heads: Ints, following: Ints, first: Ints, second: Ints
) -> tuple[Ints, Ints]:
    """Return the factors of some variables, and the variables at their other ends."""
    count = 0
    for v in moved:
        entry = heads[v]
        while entry >= 0:
            count += 1
            entry = following[entry]
    factors, others, at = np.empty(count, np.int64), np.empty(count, np.int64), 0
    for v in moved:
        entry = heads[v]
        while entry >= 0:
            factor = entry // 2
            other = second[factor] if entry % 2 == 0 else first[factor]
            factors[at], others[at] = factor, other if other >= 0 else v
            at += 1
            entry = following[entry]
    return factors, others
