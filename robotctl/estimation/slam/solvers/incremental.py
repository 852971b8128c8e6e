"""Incremental smoothing as a solver: the graph grows pose by pose, with an estimate after each."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, chi2_of
from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats, VariableKind
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.solvers.problem import Problem, Solution, Tell, check_determined
from robotctl.estimation.slam.start.chordal import matrices
from robotctl.estimation.slam.start.spanning import compose_3d


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


def carried(
    kind: VariableKind, value: Floats, anchor: VariableKind, before: Floats, now: Floats
) -> Floats:
    """Return a value (size,) as seen from a pose `before`, at where that pose is `now`."""
    if anchor is SE2:
        turn = now[2] - before[2]
        c, s = np.cos(turn), np.sin(turn)
        dx, dy = value[:2] - before[:2]
        result = value.copy()
        result[:2] = now[0] + c * dx - s * dy, now[1] + s * dx + c * dy
        if kind is SE2:
            result[2] += turn
        return result
    R = matrices(before[None, 3:])[0].T
    local = np.zeros(7)
    local[6] = 1.0
    local[:3] = R @ (value[:3] - before[:3])
    if kind is SE3:
        inverse = before * np.array([0.0, 0.0, 0.0, -1.0, -1.0, -1.0, 1.0])
        inverse[:3] = 0.0
        turned = np.empty(7)
        compose_3d(inverse, np.concatenate([np.zeros(3), value[3:]]), 0, turned)
        local[3:] = turned[3:]
    placed = np.empty(7)
    compose_3d(now, local, 0, placed)
    return placed[: kind.size]


class _Replay:
    """A problem, fed to a smoother."""

    def __init__(self, problem: Problem, smoother: IncrementalSmoother) -> None:
        self._problem = problem
        self._smoother = smoother
        graph = problem.graph
        self._numbers = {kind: np.full(len(ids), -1, np.int64) for kind, ids in graph.ids.items()}
        self._fixed = set(problem.fixed.tolist())

    def _add(self, kind: VariableKind, row: int, value: Floats) -> None:
        is_fixed = self._problem.graph.first(kind) + row in self._fixed
        self._numbers[kind][row] = self._smoother.variable(kind, value, fixed=is_fixed)

    def place(self, kind: VariableKind, row: int, anchor: tuple[VariableKind, int] | None) -> None:
        """Add a variable where its start has it, seen from an anchor that is there."""
        if self._numbers[kind][row] >= 0:
            return
        value = self._problem.start[kind][row]
        if anchor is not None:
            own, at = anchor
            now = self._smoother.estimate(int(self._numbers[own][at]))
            value = carried(kind, value, own, self._problem.start[own][at], now)
        self._add(kind, row, value)

    def step(self, pose: int, factors: list[tuple[int, int]]) -> None:
        """Add a pose and the factors that arrive with it."""
        graph, poses = self._problem.graph, self._problem.graph.poses
        if poses is not None:
            self.place(poses, pose, (poses, pose - 1) if pose else None)
        for index, row in factors:
            block = graph.blocks[index]
            ends = list(
                zip(block.kind.variables, (int(each[row]) for each in block.variables), strict=True)
            )
            for kind, at in ends:
                self.place(kind, at, None if poses is None else (poses, pose))
            self._smoother.factor(
                block.kind,
                [int(self._numbers[kind][at]) for kind, at in ends],
                block.measurements[row],
                block.information[row],
            )

    def values(self) -> Values:
        """Return the estimate of all variables."""
        return {
            kind: self._smoother.estimates(kind)[np.argsort(np.argsort(numbers))]
            for kind, numbers in self._numbers.items()
        }


def incremental(problem: Problem, tell: Tell) -> Solution:
    """Solve by incremental smoothing, in the order of the poses."""
    check_determined(problem.graph, problem.fixed)
    smoother = IncrementalSmoother()
    replay = _Replay(problem, smoother)
    steps = arrivals(problem.graph)
    tell("order", 1, 1)
    for pose, factors in enumerate(steps):
        replay.step(pose, factors)
        smoother.update()
        tell("step", pose + 1, len(steps))
    history = [chi2_of(problem.graph, each) for each in (problem.start, replay.values())]
    smoother.refine()
    history.append(chi2_of(problem.graph, replay.values()))
    weights = [np.ones(len(block)) for block in problem.graph.blocks]
    return Solution(replay.values(), history, weights, True)
