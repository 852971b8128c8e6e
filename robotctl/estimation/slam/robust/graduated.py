"""Graduated non-convexity: truncated least squares, approached from a convex cost.

Yang, Antonante, Tzoumas and Carlone, Graduated non-convexity for robust spatial perception, RA-L 5
(2020), equations 13 and 14: with mu growing, weights go from nearly equal to 0 or 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.robust.robust_cost import scale

GROWTH: Final = 1.4
_SHARP: Final = 1e4
"""Of mu: from here on all weights but those at the very edge are 0 or 1."""


@dataclass(slots=True, eq=False)
class Graduation:
    """The weights of doubtful factors while mu grows."""

    graph: FactorGraph
    doubtful: Sequence[NDArray[np.bool_]]
    mu: float = 0.0

    def begin(self, squares: Sequence[Floats]) -> None:
        """Start convex, by the worst residual."""
        worst = 1.0
        for block, s, mask in zip(self.graph.blocks, squares, self.doubtful, strict=True):
            worst = max(worst, float((s[mask] / scale(block.kind.size)).max(initial=0.0)))
        self.mu = 1.0 / max(2.0 * worst - 1.0, 1e-6)

    def advance(self) -> None:
        """Let mu grow."""
        self.mu *= GROWTH

    def is_done(self, weights: Sequence[Floats]) -> bool:
        """Return whether all weights are 0 or 1."""
        return self.mu > _SHARP or all(bool(np.all((w == 0.0) | (w == 1.0))) for w in weights)

    def weights(self, squares: Sequence[Floats]) -> list[Floats]:
        """Return the weight of each factor, (n,) a block."""
        mu = self.mu
        weights = [np.ones(len(each)) for each in squares]
        for block, w, s, mask in zip(
            self.graph.blocks, weights, squares, self.doubtful, strict=True
        ):
            share = np.maximum(s[mask] / scale(block.kind.size), 1e-12)
            between = np.sqrt(mu * (mu + 1.0) / share) - mu
            w[mask] = np.clip(between, 0.0, 1.0)
        return weights
