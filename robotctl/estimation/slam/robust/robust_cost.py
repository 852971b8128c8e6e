"""The cost of a graph with doubtful factors, and their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri  # type: ignore[import-untyped]

from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.robust.kernels import RobustKernel

_BEYOND: Final = 0.01
"""Share of right measurements that lies beyond the scale of a kernel."""
MARGIN: Final = 3.0
"""Factor on gates at the noise's scale, on squares: real noise has longer tails than a Gaussian."""
OFF: Final = 0.25
"""A factor of which a kernel leaves less than that counts as switched off."""


def scale(size: int) -> float:
    """Return c^2: what r^T Omega r of `size` numbers exceeds once in a hundred times."""
    return float(chdtri(size, _BEYOND))


@dataclass(frozen=True, slots=True, eq=False)
class RobustCost:
    """Squares, summed up: as they are, or for doubtful factors through a kernel.

    Parameters
    ----------
    graph
        The graph.
    kernel
        None: all count in full.
    doubtful
        Of each block which factors the kernel is for, (n,).
    """

    graph: FactorGraph
    kernel: RobustKernel | None
    doubtful: Sequence[NDArray[np.bool_]]

    def total(self, squares: Sequence[Floats]) -> float:
        """Return the cost of all factors with such r^T Omega r."""
        kernel = self.kernel
        if kernel is None:
            return float(sum(each.sum() for each in squares))
        total = 0.0
        for block, s, mask in zip(self.graph.blocks, squares, self.doubtful, strict=True):
            total += s[~mask].sum() + kernel.cost(s[mask], scale(block.kind.size)).sum()
        return float(total)

    def weights(self, squares: Sequence[Floats]) -> list[Floats]:
        """Return the weight of each factor, (n,) a block."""
        weights = [np.ones(len(each)) for each in squares]
        if self.kernel is not None:
            for block, w, s, mask in zip(
                self.graph.blocks, weights, squares, self.doubtful, strict=True
            ):
                w[mask] = self.kernel.weight(s[mask], scale(block.kind.size))
        return weights
