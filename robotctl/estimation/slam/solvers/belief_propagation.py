"""Gaussian belief propagation as a solver: only neighbours talk, and no matrix is factored."""

from __future__ import annotations

import math
from typing import Final

from robotctl.estimation.slam.beliefs.linear_graph import LinearGraph, Schedule
from robotctl.estimation.slam.beliefs.schedules import EmbeddedTree
from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.solvers.batch import Descent, LevenbergMarquardt, descend
from robotctl.estimation.slam.solvers.problem import Problem, Solution, Tell, check_pairs, solver

SHARE: Final = 0.1
"""Maximum error of the means as a share of the whole increment, about each linearisation."""


class _Settling(LevenbergMarquardt):
    """Ends where the messages do not settle any more."""

    def __init__(self, graph: LinearGraph) -> None:
        super().__init__()
        self._graph = graph

    def step(self, descent: Descent) -> bool:
        """Make one step; return whether to go on."""
        return super().step(descent) and self._graph.is_settled


@solver
def belief_propagation(problem: Problem, tell: Tell, schedule: Schedule | None = None) -> Solution:
    """Solve by belief propagation about one linearisation after the other.

    Steps are damped as those of Levenberg and Marquardt. It has not converged where the messages
    about a linearisation did not settle; `Solution.left_sigma` says what was left then.

    Parameters
    ----------
    problem, tell
        As for all solvers.
    schedule
        Of the messages, `EmbeddedTree` by default; any other is for graphs with few short loops.

    Raises
    ------
    GraphError
        If the factors do not determine all variables.
    """
    check_pairs(problem.graph, "gbp")
    graph = LinearGraph(problem.graph, problem.fixed, schedule or EmbeddedTree(), SHARE)
    solution = descend(problem, tell, graph, lambda: _Settling(graph))
    if not math.isfinite(graph.left):
        raise GraphError(
            "the messages have no finite solution: the factors do not determine all variables"
        )
    solution.is_converged &= graph.is_settled
    solution.rounds, solution.left_sigma = graph.rounds, graph.left
    return solution
