"""Incremental smoothing as a solver: the graph grows pose by pose, with an estimate after each."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.graph.factor import is_definite
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, chi2_of
from robotctl.estimation.slam.graph.variables import Floats, VariableKind
from robotctl.estimation.slam.incremental.consistency import Closure, ConsistentClosures
from robotctl.estimation.slam.incremental.placing import carried
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.solvers.optimum import is_optimum
from robotctl.estimation.slam.solvers.problem import (
    Problem,
    Solution,
    Tell,
    doubtful,
    solver,
)


def arrivals(graph: FactorGraph) -> list[list[tuple[int, int]]]:
    """Return for each step what arrives: blocks and rows of factors.

    A factor arrives with the later of its poses.
    """
    poses = graph.poses
    count = len(graph.ids[poses]) if poses is not None else 1
    steps: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for index, block in enumerate(graph.blocks):
        latest = np.zeros(len(block), np.int64)
        for kind, rows in zip(block.kind.variables, block.variables, strict=True):
            if kind is poses:
                latest = np.maximum(latest, rows)
        for row, step in enumerate(latest.tolist()):
            steps[step].append((index, row))
    return steps


class _Replay:
    """A problem, fed to a smoother."""

    def __init__(self, problem: Problem, smoother: IncrementalSmoother) -> None:
        self._problem = problem
        self._smoother = smoother
        graph = problem.graph
        self._numbers = {kind: np.full(len(ids), -1, np.int64) for kind, ids in graph.ids.items()}
        self._fixed = set(problem.fixed.tolist())
        self._closures = ConsistentClosures(smoother)
        self._doubtful = [np.zeros(len(each), np.bool_) for each in graph.blocks]
        if problem.kernel is not None:
            # What says nothing of some direction is no innovation with a covariance.
            self._doubtful = [
                mask & is_definite(block.information)
                for mask, block in zip(doubtful(graph), graph.blocks, strict=True)
            ]
        self._placed = {kind: np.zeros(len(ids), np.int64) for kind, ids in graph.ids.items()}
        self._of: dict[tuple[int, int], Closure] = {}

    def _add(self, kind: VariableKind, row: int, value: Floats) -> None:
        is_fixed = self._problem.graph.first(kind) + row in self._fixed
        self._numbers[kind][row] = self._smoother.variable(kind, value, fixed=is_fixed)

    def place(self, kind: VariableKind, row: int, anchor: tuple[VariableKind, int] | None) -> None:
        """Add a variable where its start has it, seen from an anchor that is there."""
        if self._numbers[kind][row] >= 0:
            return
        value = self._problem.start[kind][row]
        if anchor is not None and self._problem.graph.first(kind) + row not in self._fixed:
            own, at = anchor
            now = self._smoother.estimate(int(self._numbers[own][at]))
            value = carried(kind, value, own, self._problem.start[own][at], now)
        self._add(kind, row, value)

    def step(self, pose: int, factors: list[tuple[int, int]]) -> None:
        """Add a pose and the factors that arrive with it."""
        graph, poses = self._problem.graph, self._problem.graph.poses
        if poses is not None:
            self.place(poses, pose, (poses, pose - 1) if pose else None)
        # What links poses in a row places them, before anything doubtful is looked at.
        for index, row in sorted(factors, key=lambda each: bool(self._doubtful[each[0]][each[1]])):
            block = graph.blocks[index]
            ends = list(
                zip(block.kind.variables, (int(each[row]) for each in block.variables), strict=True)
            )
            for kind, at in ends:
                self.place(kind, at, None if poses is None else (poses, pose))
            factor = (
                block.kind,
                tuple(int(self._numbers[kind][at]) for kind, at in ends),
                block.measurements[row],
                block.information[row],
            )
            if self._doubtful[index][row] and self._is_placed(ends):
                self._of[index, row] = self._closures.add(*factor)
            else:
                self._smoother.factor(*factor, block.kernel)
            for kind, at in ends:
                self._placed[kind][at] += block.kind.size
        self._smoother.update()
        self._closures.settle()

    def _is_placed(self, ends: list[tuple[VariableKind, int]]) -> bool:
        """Return whether factors before have placed all variables: what places one must count."""
        first = self._problem.graph.first
        return all(
            self._placed[kind][at] >= kind.dof or first(kind) + at in self._fixed
            for kind, at in ends
        )

    def place_rest(self) -> None:
        """Add the variables of which no factor speaks."""
        for kind, numbers in self._numbers.items():
            for row in np.flatnonzero(numbers < 0).tolist():
                self.place(kind, row, None)

    def finish(self) -> None:
        """Make the estimate exact."""
        self._smoother.refine()
        self._closures.finish()

    def weights(self) -> list[Floats]:
        """Return of each block which factors are on, 0 or 1."""
        weights = [np.ones(len(each)) for each in self._problem.graph.blocks]
        for (index, row), (table, at) in self._of.items():
            weights[index][row] = float(table.is_on[at])
        return weights

    def values(self) -> Values:
        """Return the estimate of all variables."""
        return {
            kind: self._smoother.estimates(kind)[np.argsort(np.argsort(numbers))]
            for kind, numbers in self._numbers.items()
        }


@solver
def incremental(problem: Problem, tell: Tell) -> Solution:
    """Solve by incremental smoothing, in the order of the poses."""
    smoother = IncrementalSmoother()
    replay = _Replay(problem, smoother)
    steps = arrivals(problem.graph)
    tell("order", 1, 1)
    for pose, factors in enumerate(steps):
        replay.step(pose, factors)
        tell("step", pose + 1, len(steps))
    replay.place_rest()
    history = [chi2_of(problem.graph, each) for each in (problem.start, replay.values())]
    replay.finish()
    values, weights = replay.values(), replay.weights()
    del replay, smoother  # the check needs as much memory again
    history.append(chi2_of(problem.graph, values))
    return Solution(values, history, weights, is_optimum(problem, values, weights))
