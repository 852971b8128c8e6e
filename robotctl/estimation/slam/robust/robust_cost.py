"""The cost of a graph with doubtful factors, and their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri  # type: ignore[import-untyped]

from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.linear.assembly import inner

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

    @property
    def is_robust(self) -> bool:
        """Whether any factor has a kernel."""
        return self.kernel is not None or any(block.kernel for block in self.graph.blocks)

    def total(self, squares: Sequence[Floats], fixed: Sequence[Floats] | None = None) -> float:
        """Return the cost of all factors with such r^T Omega r.

        `fixed`, (n,) a block, are weights that stand in for those of the kernel.
        """
        total = 0.0
        for index, (block, s, mask) in enumerate(
            zip(self.graph.blocks, squares, self.doubtful, strict=True)
        ):
            c2 = scale(block.kind.size)
            costs = s if block.kernel is None else block.kernel.cost(s, c2)
            if fixed is not None:
                total += inner(fixed[index], costs)
            elif self.kernel is None:
                total += float(costs.sum())
            else:
                total += float(costs[~mask].sum() + self.kernel.cost(s[mask], c2).sum())
        return total

    def weights(
        self, squares: Sequence[Floats], fixed: Sequence[Floats] | None = None
    ) -> list[Floats]:
        """Return the weight of each factor, (n,) a block; `fixed` as for `total`."""
        weights = []
        for index, (block, s, mask) in enumerate(
            zip(self.graph.blocks, squares, self.doubtful, strict=True)
        ):
            c2 = scale(block.kind.size)
            own = np.ones(len(s)) if block.kernel is None else block.kernel.weight(s, c2)
            if fixed is not None:
                own = own * fixed[index]
            elif self.kernel is not None:
                own[mask] = self.kernel.weight(s[mask], c2)
            weights.append(own)
        return weights
