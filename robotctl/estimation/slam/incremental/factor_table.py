"""Factors of one kind that grow in number, and their matrices and gradients."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.grown import Grown
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, Ints, Linearised
from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.linear.assembly import quadratic_forms
from robotctl.estimation.slam.robust.robust_cost import scale


@compiled
def _terms(  # noqa: C901 - one compiled loop
    residuals: Floats, jacobians: Floats, begins: Ints, information: Floats, weights: Floats,
    places: Ints, is_free: NDArray[np.bool_], terms: Floats,
) -> None:  # fmt: skip
    """Write matrix and gradient of factors (n,) over those of their variables that are free.

    Parameters
    ----------
    jacobians, begins
        Those of all variables beside each other, (n, size, width), and where each begins.
    is_free
        (n, variables).
    """
    size = residuals.shape[1]
    J = np.empty((size, jacobians.shape[2]))
    for k in range(len(residuals)):
        width = 0
        for slot in range(len(begins) - 1):
            if is_free[k, slot]:
                for j in range(begins[slot], begins[slot + 1]):
                    for i in range(size):
                        J[i, width] = jacobians[k, i, j]
                    width += 1
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


class FactorTable:
    """All factors of one kind and one robust kernel, with what linearising them needs."""

    def __init__(self, kind: FactorKind, kernel: RobustKernel | None) -> None:
        self.kind, self.kernel = kind, kernel
        self.variables = Grown((len(kind.variables),), np.int64)
        self.measurements = Grown((kind.measurement,), float)
        self.information = Grown((kind.size, kind.size), float)
        self.numbers = Grown((), np.int64)
        self.weights = Grown((), float)

    def block(self, rows: Ints) -> FactorBlock:
        """Return some of the factors."""
        return FactorBlock(
            self.kind,
            tuple(np.ascontiguousarray(each) for each in self.variables.array[rows].T),
            self.measurements.array[rows],
            self.information.array[rows],
        )

    def linearise(
        self, rows: Ints, block: FactorBlock, values: tuple[Floats, ...],
        is_free: NDArray[np.bool_], places: Ints, terms: Floats,
    ) -> None:  # fmt: skip
        """Write matrix and gradient of some factors, those of a block.

        Parameters
        ----------
        rows, block
            The factors, (n,).
        values
            Of their variables, (n, size) each.
        is_free
            Which of their variables are, (n, variables).
        places, terms
            Where those of each factor begin, (n,), in these numbers.
        """
        at = Linearised.empty(block)
        at.fill(block, values)
        weights = self.weights.array[rows]
        if self.kernel is not None:
            squares = quadratic_forms(at.residuals, block.information)
            weights = weights * self.kernel.weight(squares, scale(self.kind.size))
        _terms(
            at.residuals, np.concatenate(at.jacobians, axis=2),
            np.cumsum([0, *(each.dof for each in self.kind.variables)]), block.information,
            weights, places, is_free, terms,
        )  # fmt: skip
