"""What a solver is given, and what it returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.graph.factor import Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.robust.kernels import RobustKernel

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
    """

    graph: FactorGraph
    start: Values
    fixed: Ints
    kernel: RobustKernel | None = None
    graduated: bool = False
    weights: list[Floats] | None = None
    most_iterations: int = 100
    watch: Callable[[Values], None] = field(default=lambda _: None)


@dataclass(slots=True, eq=False)
class Solution:
    """What a solver found.

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


def nobody(_what: str, _done: int, _total: int) -> None:
    """Be told, and do nothing."""


def gauge(graph: FactorGraph, fixed: Sequence[int] | Ints = ()) -> Ints:
    """Return which variables to fix so that each connected component has a place.

    That is the first pose (else the first variable) of each component without a fixed variable, a
    prior of a pose, or two positions.

    Parameters
    ----------
    graph
        The graph.
    fixed
        Numbers of variables that are fixed already; they are in the result.
    """
    component = graph.components()
    places = np.zeros(graph.size, np.int64)  # a pose in the plane needs two
    places[np.asarray(fixed, np.int64)] = 2
    for block in graph.blocks:
        if len(block.kind.variables) == 1:
            variable = block.kind.variables[0]
            whole = variable.is_pose and block.kind.size == variable.dof
            placed = 1 if block.kind.size >= variable.positions else 0
            enough = 2 if whole else placed
            np.add.at(places, graph.numbers(block)[0], enough)
    # In space, two positions leave a turn about the line through them.
    needed = 3 if graph.poses is not None and graph.poses.positions == 3 else 2
    places[places >= 2] = np.maximum(places[places >= 2], needed)
    held = np.bincount(component, places)
    firsts = np.unique(component, return_index=True)[1]
    missing = firsts[held < needed]
    return np.unique(np.concatenate([np.asarray(fixed, np.int64), missing])).astype(np.int64)


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
        for numbers in graph.numbers(block):
            np.add.at(known, numbers, block.kind.size)
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
            if len(numbers := graph.numbers(block)) == 2
            for mine, others in (numbers, numbers[::-1])
            for other in others[mine == number]
        }
    )
    near = f" (linked to {graph.names(linked)})" if linked else ""
    return GraphError(
        f"{graph.name(number)}{near}: the factors do not determine it; the graph needs a prior, "
        "or more measurements of what is named"
    )


def doubtful(graph: FactorGraph) -> list[NDArray[np.bool_]]:
    """Return of each block which factors may be wrong: all of two variables but odometry.

    Odometry is what links a pose with the next one.
    """
    masks = []
    for block in graph.blocks:
        is_pair = len(block.variables) == 2
        mask = np.full(len(block), is_pair)
        if is_pair and block.kind.variables[0] is block.kind.variables[1]:
            mask = np.abs(block.variables[1] - block.variables[0]) != 1
        masks.append(mask)
    return masks
