"""Incremental smoothing on any factors: add, remove, and have the estimate after each step.

Variables far from where they were linearised are linearised anew (fluid relinearisation), and only
increments that change are passed on (the wildfire threshold), as in iSAM2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.graph.factor import FactorKind, Ints, Linearised
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.incremental import held
from robotctl.estimation.slam.incremental.bayes_tree import Cliques, Links, columns_of, tidy
from robotctl.estimation.slam.incremental.growing_graph import GrowingGraph, Pending
from robotctl.estimation.slam.incremental.renewal import renew
from robotctl.estimation.slam.incremental.sweeps import paths_up, solve_down, squared, sweep_up

_EXACT: Final = 1e-4
_WAIT: Final = 10
"""Updates of a large tree from one look at the points of linearisation to the next."""
_GAPS: Final = 8
_MOVED: Final = 2**19
"""After updates of a large tree that do not renew it, gaps in it are closed where more than one
number in so many is of one, by moving at most so many numbers."""


@dataclass(frozen=True, slots=True)
class SmootherConfig:
    """How exact the estimate is, and when work is put off.

    Parameters
    ----------
    relinearise
        Increments beyond which a variable is linearised anew [m, rad].
    wildfire
        Changes of increments that are not passed on [m, rad].
    renewal
        Multiplications beyond which eliminating again what new factors reach is put off.
    """

    relinearise: float = 0.1
    wildfire: float = 1e-3
    renewal: float = 1e7


class IncrementalSmoother(GrowingGraph):
    """The estimate of a graph that grows."""

    def __init__(self, config: SmootherConfig | None = None) -> None:
        super().__init__()
        self.config = config or SmootherConfig()
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
            np.zeros(4, np.int64),
        )
        self._held = held.Held()
        self._is_large, self._unseen = False, 0

    def forecast(
        self, kind: FactorKind, variables: Sequence[int], measurement: Floats
    ) -> tuple[Floats, Floats]:
        """Return the residual (size,) that a factor would have, and its covariance J P J^T.

        P is the covariance of the estimate as it was updated last; without the factor's own noise.
        """
        at = Linearised.of_one(kind, tuple(map(self.estimate, variables)), measurement)
        free = [slot for slot, each in enumerate(variables) if self._dof.array[each]]
        jacobian = np.hstack([at.jacobians[slot][0] for slot in free] or [np.empty((kind.size, 0))])
        numbers = np.array([variables[slot] for slot in free], np.int64)
        return at.residuals[0], self._covariance(numbers, np.ascontiguousarray(jacobian))

    def covariance(self, number: int) -> Floats:
        """Return the covariance (dof, dof) of a variable, in its tangent space; if fixed, 0.

        It is that of the estimate as it was updated last.
        """
        width = self._dof.array[number]
        if width == 0:
            return np.zeros((self._kinds[number].dof, self._kinds[number].dof))
        return self._covariance(np.array([number]), np.eye(width))

    def _covariance(self, numbers: Ints, jacobian: Floats) -> Floats:
        """Return J P J^T (m, m) with J (m, n) over the columns of free variables."""
        columns = columns_of(self._offsets.view, self._dof.view, numbers)
        reached, Y, _ = sweep_up(
            self._cliques, self._clique_of.view, numbers, columns, jacobian, self._increments.size
        )
        return squared(Y) - self._held.known(reached, Y)

    def update(self) -> bool:
        """Take in what was added; return whether anything changed.

        Raises
        ------
        GraphError
            If the values have left all bounds; the smoother is of no use then.
        """
        self._unseen += 1
        if not self._is_large or self._unseen >= _WAIT:
            self._unseen = 0
            self._move(self.config.relinearise)
        pending = self._pending
        if not pending.touched:
            return False
        self._linearise(np.unique(np.array(pending.factors, np.int64)))
        links, clique_of = self._links(), self._clique_of.view
        touched = np.array(self._held.touched + pending.touched, np.int64)
        if not (pending.only_new and self._hold(links, touched)):
            is_new = np.zeros(self._dof.size, np.bool_)
            is_new[pending.new] = True
            if self._held.touched:
                self._held = held.Held()
            self._cliques, first = renew(self._cliques, links, clique_of, touched, is_new)
            if first < 0:
                raise GraphError(
                    "the smoother's equations have no solution: values have left all bounds; begin "
                    "nearer, or use lm"
                )
            is_due = np.arange(self._cliques.used[0]) >= first
        else:
            tidy(self._cliques, clique_of, touched[:0], _GAPS, _MOVED)
            is_due = paths_up(self._cliques, clique_of, touched)
        solve_down(
            self._cliques, is_due, self._held.shift(self._increments.size), self.config.wildfire,
            self._increments.view,
        )  # fmt: skip
        self._pending = Pending()
        return True

    def _hold(self, links: Links, touched: Ints) -> bool:
        """Hang new variables to the tree, and hold the other factors; return whether that is done.

        It is not where the tree is renewed as quickly, or where nothing determines a variable.
        """
        pending, clique_of, own = self._pending, self._clique_of.view, self._held
        rows = sum(self._factors[self._block_of.array[each]].kind.size for each in pending.factors)
        work = held.work_of(self._cliques, clique_of, touched)
        self._is_large = work > self.config.renewal
        if not self._is_large or not own.has_room(rows):
            return False
        left = dict.fromkeys(pending.factors)
        for number in pending.new:
            for factor in left:
                begin, end = self._begins.array[factor : factor + 2]
                if number not in self._ends.array[begin:end]:
                    continue
                self._cliques, is_done = held.hang(self._cliques, links, clique_of, number, factor)
                if is_done:
                    del left[factor]
                    break
            else:
                return False
        own.add(self._cliques, links, clique_of, np.array(list(left), np.int64))
        own.touched += pending.touched
        return True

    def refine(self, most: int = 10) -> None:
        """Relinearise until nothing changes that matters, in at most so many updates."""
        config = self.config
        self._is_large = False
        self.config = replace(config, relinearise=_EXACT, wildfire=0.0)
        for _ in range(most):
            if not self.update():
                break
        self.config = config
