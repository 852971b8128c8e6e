"""Factors that may be wrong, apart from the smoother that they are added to when they are on."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri  # type: ignore[import-untyped]

from robotctl.estimation.grown import Grown
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.robust.robust_cost import scale

NEVER: Final = -1
"""Stands for the number in the smoother of a factor that was never on."""


class Closures:
    """All factors of one kind that may be wrong, as arrays by row."""

    def __init__(self, smoother: IncrementalSmoother, kind: FactorKind) -> None:
        self._smoother = smoother
        self.kind = kind
        self.gate = scale(kind.size)
        """Square that a right one exceeds once in a hundred times."""
        self.median = float(chdtri(kind.size, 0.5))
        """Square that half of the right ones exceed."""
        self._variables = Grown((len(kind.variables),), np.int64)
        self._rows = Grown((len(kind.variables),), np.int64)
        self._measurements = Grown((kind.measurement,), float)
        self._information = Grown((kind.size, kind.size), float)
        self._factors = Grown((), np.int64)
        self._is_on = Grown((), np.bool_)

    def add(self, variables: tuple[int, ...], measurement: Floats, information: Floats) -> int:
        """Add a factor that is off; return its row."""
        self._rows.add([[self._smoother.row(each) for each in variables]])
        self._measurements.add(measurement[None])
        self._information.add(information[None])
        self._factors.add((NEVER,))
        self._is_on.add((False,))
        return self._variables.add([variables])

    @property
    def is_on(self) -> NDArray[np.bool_]:
        """Which of them count, (n,)."""
        return self._is_on.view

    def variables(self, row: int) -> tuple[int, ...]:
        """Return the numbers of the variables of one."""
        return tuple(self._variables.array[row].tolist())

    def measurement(self, row: int) -> Floats:
        """Return what one measured."""
        result: Floats = self._measurements.array[row]
        return result

    def noise(self, row: int) -> Floats:
        """Return the covariance of the residual of one, (size, size)."""
        return np.linalg.inv(self._information.array[row]).astype(np.float64)

    def switch(self, row: int, *, on: bool) -> None:
        """Let one count or not, from the next update of the smoother on."""
        if self._is_on.array[row] == on:
            return
        self._is_on.array[row] = on
        factor = int(self._factors.array[row])
        if factor == NEVER:
            self._factors.array[row] = self._smoother.factor(
                self.kind, self.variables(row), self.measurement(row), self._information.array[row]
            )
        else:
            self._smoother.weigh(factor, 1.0 if on else 0.0)

    def innovation(self, row: int) -> tuple[Floats, Floats]:
        """Return the residual that one has before it is added, and its covariance."""
        r, P = self._smoother.forecast(self.kind, self.variables(row), self.measurement(row))
        return r, P + self.noise(row)

    def squares(self) -> Floats:
        """Return r^T Omega r of all at the estimate, (n,)."""
        values = [
            self._smoother.estimates_of(kind, rows)
            for kind, rows in zip(self.kind.variables, self._rows.view.T, strict=True)
        ]
        r = self.kind.residual(*values, self._measurements.view)
        result: Floats = np.einsum("ni,nij,nj->n", r, self._information.view, r)
        return result
