"""Whether values are an optimum, whoever found them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robotctl.estimation.slam.equations import NormalEquations
from robotctl.estimation.slam.graph.factor_graph import Values
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.linear.assembly import inner
from robotctl.estimation.slam.solvers.problem import Problem

_SHARE: Final = 1e-6
"""Part of chi2 that a further step may still be worth."""
_SMALL: Final = 1e-6
"""The same as a number: squared standard deviations."""
_DAMPING: Final = 1e-9


def is_optimum(problem: Problem, values: Values, weights: Sequence[Floats]) -> bool:
    """Return whether a Gauss-Newton step would lower chi2 by next to nothing.

    Parameters
    ----------
    problem
        Its graph and fixed variables are used.
    values
        Of all variables.
    weights
        Of each block, factors on the information, (n,).
    """
    equations = NormalEquations(problem.graph, problem.fixed)
    at = equations.linearise(values)
    equations.assemble(at, weights)
    # Along what is not determined there is nothing to gain, and next to no damping takes it away.
    if equations.factorise(_DAMPING * equations.diagonal) is not None:
        return False
    gain = -inner(equations.gradient, equations.solve())
    total = sum(inner(w, s) for w, s in zip(weights, at.squares, strict=True))
    return gain <= _SHARE * total + _SMALL
