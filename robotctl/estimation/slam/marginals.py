"""Covariances of chosen variables, without the inverse of the whole matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robotctl.estimation.slam.equations import NormalEquations
from robotctl.estimation.slam.graph.factor import Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.solvers.anchors import anchored, anchors
from robotctl.estimation.slam.solvers.problem import singular


def factored(
    graph: FactorGraph, values: Values, fixed: Ints, weights: Sequence[Floats]
) -> NormalEquations:
    """Return the equations at values, with their Cholesky factor.

    Directions that nothing determines are held, as by the solvers: next to no variance.

    Raises
    ------
    GraphError
        If the factors do not determine all variables; it names one.
    """
    held = anchors(graph, values, fixed)
    equations = NormalEquations(anchored(graph, values, held), fixed)
    if held:
        weights = [*weights, np.ones(len(held))]
    equations.assemble(equations.linearise(values), weights)
    failed = equations.factorise()
    if failed is not None:
        raise singular(graph, failed)
    return equations


def marginals(equations: NormalEquations, numbers: Sequence[int]) -> list[Floats]:
    """Return the covariances (dof, dof) of variables, in their tangent spaces.

    Of a pose that is its own frame: x forward, y left [m], then rotation [rad]. A fixed variable
    has the covariance 0.

    Parameters
    ----------
    equations
        Factored, at the optimum.
    numbers
        Of the variables.
    """
    dof = equations.graph.dof()
    results = []
    for number in numbers:
        first, width = int(equations.columns[number]), int(dof[number])
        covariance = np.zeros((width, width))
        for column in range(width if first >= 0 else 0):
            unit = np.zeros(equations.total)
            unit[first + column] = 1.0
            covariance[:, column] = equations.solve(unit)[first : first + width]
        results.append(0.5 * (covariance + covariance.T))
    return results
