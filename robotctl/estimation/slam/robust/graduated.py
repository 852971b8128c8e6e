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
from scipy.special import chdtri  # type: ignore[import-untyped]

from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.robust.robust_cost import MARGIN, scale

GROWTH: Final = 1.4
_LEAST: Final = 1e-6
"""Minimum scale of the noise: simulated loops may fit to the last digit."""
_SHARP: Final = 1e4
"""Value of mu from which on all weights but those at the very edge are 0 or 1."""


@dataclass(slots=True, eq=False)
class Graduation:
    """The weights of doubtful factors while mu grows."""

    graph: FactorGraph
    doubtful: Sequence[NDArray[np.bool_]]
    mu: float = 0.0

    def _shares(self, squares: Sequence[Floats]) -> list[Floats]:
        """Return squares of doubtful factors over what a right one seldom exceeds.

        Half of them are taken for right: their median says how far the information is off.
        """
        own = [s[mask] for s, mask in zip(squares, self.doubtful, strict=True)]
        if not any(len(each) for each in own):
            return own
        sizes = [block.kind.size for block in self.graph.blocks]
        ratios = [s / float(chdtri(size, 0.5)) for s, size in zip(own, sizes, strict=True)]
        noise = MARGIN * max(float(np.median(np.concatenate(ratios))), _LEAST)
        return [s / (noise * scale(size)) for s, size in zip(own, sizes, strict=True)]

    def begin(self, squares: Sequence[Floats]) -> None:
        """Start convex, by the worst residual."""
        worst = max((float(each.max(initial=1.0)) for each in self._shares(squares)), default=1.0)
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
        for w, share, mask in zip(weights, self._shares(squares), self.doubtful, strict=True):
            between = np.sqrt(mu * (mu + 1.0) / np.maximum(share, 1e-12)) - mu
            w[mask] = np.clip(between, 0.0, 1.0)
        return weights
