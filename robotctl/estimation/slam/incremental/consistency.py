"""Loop closures that the graph contradicts are switched off as they arrive, and on again if not.

Wanted are the closures whose truncated sum of squares is least: one that is on costs its part of
chi2, one that is off the gate. A closure that is added raises chi2 by its normalised innovation,
r^T (R + J P J^T)^-1 r: what Olivastri and Pretto (IPC, IEEE RA-L 2024) find by optimising each time
follows from the Bayes tree. If that is below the gate, and the graph known so well that hardly any
closure would pass by chance, the closure is on. Where the graph is vague it waits for another one
that says the same over the short way between their ends (pairwise consistency: Olson, ICRA 2009;
Mangelson et al., ICRA 2018). Closures that are off and agree contest those that are on: they stay
if the sum is smaller so. What is on and fits no more is off again, and the other way round, as in
riSAM (McGann, Rogers, Kaess, ICRA 2023).

Information matrices of public graphs are wrong by factors of fifty. A gate is of use only at the
scale of the noise, so that is estimated: the median of all innovations says it.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np

from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.graph.checks import check_numbers
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.incremental.closures import Closures
from robotctl.estimation.slam.incremental.cycles import cycle_nis
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.robust.robust_cost import MARGIN

Closure: TypeAlias = tuple[Closures, int]
"""A factor that may be wrong: those of its kind, and its row."""

_CHANCE: Final = 1e-3
"""Share of the closures drawn at random that may pass unnoticed."""
_NEAR: Final = 12
"""Variables between the ends of closures that are compared."""
_PRIOR: Final = 10
"""Innovations as stated that the scale of the noise begins with."""
_STRAINED: Final = 0.05
"""Share of the gate beyond which a closure may be in conflict with others."""
_ROUNDS: Final = 8


class ConsistentClosures:
    """The doubtful factors of a smoother, and which of them are on."""

    def __init__(self, smoother: IncrementalSmoother) -> None:
        self._smoother = smoother
        self._tables: dict[FactorKind, Closures] = {}
        self._fresh: list[Closure] = []
        self._ratios = [1.0] * _PRIOR
        self._places: dict[tuple[int, ...], list[Closure]] = {}

    @property
    def noise(self) -> float:
        """How much larger squares are than the information says."""
        return self._ratios[len(self._ratios) // 2]

    def add(
        self, kind: FactorKind, variables: tuple[int, ...], measurement: Floats, information: Floats
    ) -> Closure:
        """Add a factor that may be wrong, as to `IncrementalSmoother.factor`; it is off.

        Its information must not be singular.
        """
        self._smoother.check_ends(kind, variables)
        check_numbers(kind, measurement[None], information[None])
        table = self._tables.setdefault(kind, Closures(self._smoother, kind))
        closure = table, table.add(variables, measurement, information)
        self._fresh.append(closure)
        return closure

    def settle(self) -> None:
        """Decide on what was added, after an update of the smoother, and look at all again."""
        fresh, self._fresh = self._fresh, []
        if not fresh:
            return
        refused = []
        for table, row in fresh:
            if not self._judge(table, row, is_new=True):
                refused.append((table, row))
            self._places.setdefault(_place(table, row), []).append((table, row))
        self._revise()
        for table, row in refused:
            if not table.is_on[row]:
                self._contest(table, row)

    def finish(self) -> None:
        """Look at all again, with an estimate that is exact; it is exact for what is on then."""
        for _ in range(_ROUNDS):
            self._smoother.refine()
            if not self._revise():
                break

    def _judge(self, table: Closures, row: int, *, is_new: bool = False) -> bool:
        """Switch a closure on if it may be; return whether the graph allows it."""
        r, S = table.innovation(row)
        try:
            L = np.asarray(np.linalg.cholesky(S), np.float64)
        except np.linalg.LinAlgError:
            raise GraphError(
                "the covariance of a closure is no covariance any more: measurements differ too "
                "much in precision, or positions are too far from 0; solve without --robust "
                "consistent"
            ) from None
        nis = float(r @ np.linalg.solve(S, r))
        if is_new:
            insort(self._ratios, nis / table.median)
        gate = self._gate(table)
        if nis > gate:
            return False
        if self._chance(table.kind, gate, L) < _CHANCE:
            table.switch(row, on=True)
            return True
        agreeing = self._agreeing(table, row)
        if agreeing:
            self._switch_on([(table, row), *agreeing])
        return True

    def _gate(self, table: Closures) -> float:
        """Return what the square of a right closure seldom exceeds."""
        return MARGIN * self.noise * table.gate

    def _chance(self, kind: FactorKind, gate: float, L: Floats) -> float:
        """Return with which probability a closure would pass that is drawn at random.

        That is the volume inside the gate over that of all poses on the map; L is the Cholesky
        factor of the closure's covariance. Sightings of points are no such draws: their names are
        known.
        """
        pose = kind.variables[0]
        if not all(each.is_pose for each in kind.variables):
            return 0.0
        sides = np.ptp(self._smoother.estimates(pose)[:, : pose.positions], axis=0)
        turns = kind.size - pose.positions
        ball = 4.0 / 3.0 * np.pi if kind.size == 3 else np.pi**3 / 6.0
        inside = ball * gate ** (kind.size / 2) * np.prod(np.diag(L))
        return float(inside / (np.prod(np.maximum(sides, 1.0)) * (2.0 * np.pi) ** turns))

    def _agreeing(self, table: Closures, row: int) -> list[Closure]:
        """Return closures that are near, and say the same as one."""
        kind, own = table.kind, np.array(table.variables(row))
        if kind.size != kind.variables[0].dof:
            return []
        a, b = _place(table, row)
        near = [
            other
            for da in (-1, 0, 1)
            for db in (-1, 0, 1)
            for other in self._places.get((a + da, b + db), ())
        ]
        return [
            (table, other)
            for each, other in near
            if each is table
            and other != row
            and np.max(np.abs(own - table.variables(other))) <= _NEAR
            and cycle_nis(self._smoother, table, other, row) <= self._gate(table)
        ]

    def _revise(self) -> bool:
        """Switch off what does not fit, one by one, then on what does; return whether any."""
        changed = False
        for _ in range(_ROUNDS):
            self._smoother.update()
            if not (self._switch_worst_off(1.0) or self._switch_fitting_on()):
                break
            changed = True
        return changed

    def _switch_worst_off(self, most: float, but: Sequence[Closure] = ()) -> bool:
        """Switch off what is on and fits least, beyond so much of the gate; return whether."""
        worst = None
        for table in self._tables.values():
            shares = np.where(table.is_on, table.squares() / self._gate(table), 0.0)
            shares[[row for other, row in but if other is table]] = 0.0
            row = int(np.argmax(shares))
            if shares[row] > most:
                most, worst = float(shares[row]), (table, row)
        if worst is None:
            return False
        worst[0].switch(worst[1], on=False)
        return True

    def _switch_fitting_on(self) -> bool:
        """Judge all again that are off and fit the estimate; return whether any is on now."""
        count = self._count_on()
        for table in self._tables.values():
            fits = ~table.is_on & (table.squares() <= self._gate(table))
            for row in np.flatnonzero(fits).tolist():
                self._judge(table, row)
        return self._count_on() > count

    def _count_on(self) -> int:
        return sum(int(table.is_on.sum()) for table in self._tables.values())

    def _switch_on(self, closures: list[Closure]) -> None:
        for table, row in closures:
            table.switch(row, on=True)

    def _cost(self) -> float:
        """Return the truncated sum of squares."""
        off = sum(
            self._gate(table) * float((~table.is_on).sum()) for table in self._tables.values()
        )
        return self._smoother.chi2() + off

    def _contest(self, table: Closures, row: int) -> None:
        """Try a closure that is off with those that agree; they stay on if that costs less."""
        agreeing = [(each, k) for each, k in self._agreeing(table, row) if not each.is_on[k]]
        if not agreeing:
            return
        before = [(each, each.is_on.copy()) for each in self._tables.values()]
        cost = self._cost()
        group = [(table, row), *agreeing]
        self._switch_on(group)
        # Odometry may give way to both sides, so that each fits; then who fits least goes.
        for _ in group:
            self._revise()
            if self._cost() < cost:
                return
            if not self._switch_worst_off(_STRAINED, group):
                break
        for each, was_on in before:
            for other in np.flatnonzero(each.is_on != was_on).tolist():
                each.switch(other, on=bool(was_on[other]))
        self._smoother.refine()


def _place(table: Closures, row: int) -> tuple[int, ...]:
    """Return about where among the variables a closure is."""
    return tuple(each // _NEAR for each in table.variables(row))
