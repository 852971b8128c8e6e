"""Input and result of a solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import update_wrapper
from itertools import permutations
from typing import Concatenate, ParamSpec, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.equations import GraphError, linearise
from robotctl.estimation.slam.graph.checks import check_values
from robotctl.estimation.slam.graph.factor import Ints, is_semidefinite
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, chi2_of
from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import KINDS, Floats
from robotctl.estimation.slam.robust.robust_cost import RobustCost
from robotctl.estimation.slam.solvers.anchors import Anchor, anchored, anchors, outer_factors

P = ParamSpec("P")

Tell: TypeAlias = Callable[[str, int, int], None]
"""Is told what was done: its name ("order", "iteration", "step"), how far, and of how many."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A graph with a start.

    Parameters
    ----------
    graph, start
        Variables and factors, and where to begin.
    fixed
        Numbers of the variables that keep their start: the gauge, see `gauge`.
    kernel
        Robust kernel of the factors that may be wrong (`doubtful`); None: least squares.
    graduated
        Whether the kernel grows from a convex one: graduated non-convexity.
    weights
        Of each block, factors on the information that stay, (n,); None: those of the kernel.
    most_iterations
        At which a solver gives up.
    watch
        Given the values at the start and after each iteration by solvers that improve all at once.

    Raises
    ------
    ValueError
        If the start has other shapes than the graph, or a number cannot be: not finite, or an
        information matrix with a negative eigenvalue.
    """

    graph: FactorGraph
    start: Values
    fixed: Ints
    kernel: RobustKernel | None = None
    graduated: bool = False
    weights: list[Floats] | None = None
    most_iterations: int = 100
    watch: Callable[[Values], None] = field(default=lambda _: None)

    def __post_init__(self) -> None:
        graph = self.graph
        fixed = np.unique(np.asarray(self.fixed, np.int64))
        if len(fixed) and not (fixed[0] >= 0 and fixed[-1] < graph.size):
            raise ValueError(
                f"fixed: {fixed[0]} to {fixed[-1]} found; variables go from 0 to {graph.size - 1}"
            )
        object.__setattr__(self, "fixed", fixed)
        check_values(graph.counts, self.start, numbers=True)
        for block in graph.blocks:
            good = is_semidefinite(block.information)
            if not np.all(good):
                raise ValueError(
                    f"factors {block.kind.name!r}: information[{int(np.argmin(good))}] has a "
                    "negative eigenvalue; positive semidefinite matrices are needed"
                )
        sizes = [len(block) for block in graph.blocks]
        if self.weights is not None and [len(each) for each in self.weights] != sizes:
            raise ValueError(f"weights: {[len(each) for each in self.weights]} found, a weight "
                             f"for each factor needed: {sizes}")  # fmt: skip


@dataclass(slots=True, eq=False)
class Solution:
    """Result of a solver.

    Parameters
    ----------
    values
        Of all variables.
    chi2
        At the start and after each iteration or step, as far as it was computed.
    weights
        Of each block, factors on the information that a robust kernel gave at the end, (n,).
    is_converged
        Whether it ended by itself.
    rounds
        Of messages; 0 for a solver without.
    left_sigma
        How far the means of the last messages may be off, in standard deviations.
    """

    values: Values
    chi2: list[float]
    weights: list[Floats]
    is_converged: bool
    rounds: int = 0
    left_sigma: float = 0.0


Solver: TypeAlias = Callable[[Problem, Tell], Solution]


def solver(
    solve: Callable[Concatenate[Problem, Tell, P], Solution],
) -> Callable[Concatenate[Problem, Tell, P], Solution]:
    """Make a solver out of what solves problems that have one solution.

    It sees none without unknowns: then the start is the solution. Directions that nothing
    determines are held (`anchors`), and fixed variables keep their start to the last digit.
    """

    def checked(problem: Problem, tell: Tell, /, *args: P.args, **options: P.kwargs) -> Solution:
        graph, fixed = problem.graph, problem.fixed
        if len(fixed) == graph.size:
            return _as_it_stands(problem)
        held, start = anchors(graph, problem.start, fixed), problem.start
        history: list[float] = []
        while True:
            solution = solve(_held(problem, start, held), tell, *args, **options)
            history += solution.chi2[1 if history else 0 :]
            # At another place less may have to be held: poses that stood together now do not.
            still = anchors(graph, solution.values, fixed) if held else held
            if _held_coordinates(still) >= _held_coordinates(held):
                break
            held, start = still, solution.values
        for kind, rows in graph.rows(fixed).items():
            solution.values[kind][rows] = problem.start[kind][rows]
        del solution.weights[len(graph.blocks) :]
        if held:
            history[-1] = chi2_of(graph, solution.values)
        solution.chi2 = history
        return solution

    update_wrapper(checked, solve)
    return checked


def _held(problem: Problem, start: Values, held: Sequence[Anchor]) -> Problem:
    """Return a problem that has a solution, at a start, with anchors.

    Raises
    ------
    GraphError
        If there are too few measurements of a variable.
    """
    graph = anchored(problem.graph, start, held)
    check_determined(graph, problem.fixed)
    if not held:
        return problem
    weights = problem.weights
    if weights is not None:
        weights = [*weights, np.ones(len(held))]
    return replace(problem, graph=graph, start=start, weights=weights)


def _held_coordinates(held: Sequence[Anchor]) -> int:
    return sum(len(each.coordinates) for each in held)


def _as_it_stands(problem: Problem) -> Solution:
    """Return the start as the solution."""
    graph = problem.graph
    at = linearise(graph, problem.start)
    cost = RobustCost(graph, problem.kernel, doubtful(graph))
    weights = cost.weights(at.squares, problem.weights)
    return Solution(problem.start, [at.chi2], weights, is_converged=True)


def nobody(_what: str, _done: int, _total: int) -> None:
    """Be told, and do nothing."""


def gauge(graph: FactorGraph, fixed: Sequence[int] | Ints = ()) -> Ints:
    """Return which variables to fix so that each connected component has a place.

    That is the first pose (else the first variable) of each component that has no factor with a
    fixed variable, and no prior or position either. Where these leave a component some freedom,
    solvers hold just that (`anchors`).

    Parameters
    ----------
    graph
        The graph.
    fixed
        Numbers of variables that are fixed already; they are in the result.
    """
    fixed = np.asarray(fixed, np.int64)
    component = graph.components(fixed)
    firsts = np.unique(component, return_index=True)[1]
    is_placed = np.zeros(len(firsts), np.bool_)
    is_placed[component[fixed]] = True
    for block, slot in outer_factors(graph, fixed):
        is_placed[component[graph.numbers(block)[slot]]] = True
    return np.unique(np.concatenate([fixed, firsts[~is_placed]])).astype(np.int64)


def check_pairs(graph: FactorGraph, name: str) -> None:
    """Refuse what a solver for poses, points and pairs of them cannot solve.

    Raises
    ------
    GraphError
        With the solver's name, and what was found.
    """
    for block in graph.blocks:
        kinds = block.kind.variables
        if len(kinds) > 2 or any(each not in KINDS for each in kinds):
            found = ", ".join(map(repr, kinds))
            raise GraphError(
                f"{name} takes factors of one or two poses and points; factors "
                f"{block.kind.name!r} of {found} need gn, lm, dogleg or isam"
            )


def check_determined(graph: FactorGraph, fixed: Ints) -> None:
    """Refuse variables with fewer measured numbers than unknown ones.

    Raises
    ------
    GraphError
        With the names of the variables.
    """
    known = np.zeros(graph.size, np.int64)
    known[fixed] = np.iinfo(np.int32).max
    for block in graph.blocks:
        # A zero on the diagonal of what is positive semidefinite has zeros all around it.
        told = np.count_nonzero(np.diagonal(block.information, axis1=1, axis2=2), axis=1)
        for numbers in graph.numbers(block):
            np.add.at(known, numbers, told)
    short = np.flatnonzero(known < graph.dof())
    if len(short):
        raise GraphError(
            f"{graph.names(short.tolist())}: too few measurements to determine "
            f"{'it' if len(short) == 1 else 'them'}; remove {'it' if len(short) == 1 else 'them'} "
            "or add a prior"
        )


def singular(graph: FactorGraph, number: int) -> GraphError:
    """Return the error for a matrix that is not positive definite at a variable."""
    linked = sorted(
        {
            int(other)
            for block in graph.blocks
            for mine, others in permutations(graph.numbers(block), 2)
            for other in others[mine == number]
        }
    )
    near = f" (linked to {graph.names(linked)})" if linked else ""
    return GraphError(
        f"{graph.name(number)}{near}: the factors do not determine it at these values; the graph "
        "needs a prior, more measurements of what is named, or another start"
    )


def doubtful(graph: FactorGraph) -> list[NDArray[np.bool_]]:
    """Return of each block which factors may be wrong: those of several variables but odometry.

    Odometry is what links a pose with the next one. Factors with a kernel of their own are not
    among them.
    """
    masks = []
    for block in graph.blocks:
        mask = np.full(len(block), len(block.variables) > 1 and block.kernel is None)
        kinds = block.kind.variables
        if np.any(mask) and len(kinds) == 2 and kinds[0] is kinds[1]:
            mask = np.abs(block.variables[1] - block.variables[0]) != 1
        masks.append(mask)
    return masks
