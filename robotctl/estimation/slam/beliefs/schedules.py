"""Orders of messages: on a tree and back, all at once, or the most urgent first.

On trees all of them are exact. Around loops, where messages settle, the means of `Synchronous` and
`Residual` are exact and the precisions too large, since a belief counts the same factors more than
once (Weiss and Freeman, Neural Computation 13, 2001). The precisions do settle, as all links are
positive semidefinite (Moallemi and Van Roy, IEEE Trans. Information Theory 55, 2009), and quickly;
means on long loops take so many rounds that only `EmbeddedTree` is of use there.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.beliefs.kernels import product, send_all, send_by_residual
from robotctl.estimation.slam.beliefs.linear_graph import LinearGraph, Means
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.linear.assembly import inner

_PATIENCE: Final = 3000
"""Rounds about one linearisation."""
_SETTLED: Final = 1e-7
"""Share by which settled precisions may change in a round."""
_NOTHING: Final = 1e-14
"""Share of the precision of all factors at a variable that is nothing but rounding."""


class EmbeddedTree:
    """Messages to the roots of a spanning forest and back, again and again.

    The embedded trees algorithm (Sudderth, Wainwright and Willsky, IEEE Trans. Signal Processing
    52, 2004): the forest answers what its means have left over of all factors. Directions are
    conjugate, as in Dellaert et al., Subgraph-preconditioned conjugate gradients (IROS 2010). The
    two sums over all variables that this takes can be collected on the forest as well.
    """

    most_rounds = 4 * _PATIENCE

    def begin(self, graph: LinearGraph) -> None:
        """Begin on a graph with new numbers."""
        self._means = graph.judge(np.zeros_like(graph.vectors))
        self._direction = self._means.answer.copy()

    def round(self, graph: LinearGraph) -> Means:
        """Go once to the roots and back."""
        x, rest, answer = self._means
        p, before = self._direction, inner(rest, answer)
        if before > 0.0:
            H_p = product(graph.ends, graph.H, graph.precisions, p)
            step = before / inner(p, H_p)
            rest = rest - step * H_p
            self._means = Means(x + step * p, rest, graph.answer(rest))
            gain = inner(rest, self._means.answer) / before
            self._direction = self._means.answer + gain * p
        return self._means

    def shift(self, _increments: Floats) -> None:
        """Keep nothing from one linearisation to the next."""


class Synchronous:
    """All messages at once.

    Parameters
    ----------
    damping
        Share of the old messages that is kept, [0, 1).
    """

    most_rounds = _PATIENCE

    def __init__(self, damping: float = 0.0) -> None:
        self._damping = damping
        self.said = np.empty((0, 0, 0))
        """The messages, (2 links, D, D + 1): precisions, and vectors as the last column."""

    def begin(self, graph: LinearGraph) -> None:
        """Begin where the last linearisation ended; at first, with settled precisions.

        These do not depend on the means. Means that begin before would come from next to nothing,
        lie kilometres away, and take their rounds to come back.
        """
        if not self.said.size:
            self.precisions(graph)
            self.said[..., -1] = 0.0
        self._take(graph)

    def _take(self, graph: LinearGraph) -> None:
        """Take the numbers of a graph."""
        if not self.said.size:
            self.said = np.zeros((2 * len(graph.ends), graph.D, graph.D + 1))
        self._receivers = graph.ends[:, ::-1].ravel()
        self._own = np.concatenate([graph.precisions, graph.vectors[..., None]], axis=2)

    def round(self, graph: LinearGraph) -> Means:
        """Send each message once."""
        self._send(graph)
        beliefs, places = self.beliefs(), np.arange(graph.D)
        # Of some variables nothing may be known yet.
        beliefs[:, places, places] += _NOTHING * graph.scales
        x = np.linalg.solve(beliefs[..., :-1], beliefs[..., -1:])[..., 0]
        return graph.judge(x.astype(np.float64))

    def _send(self, graph: LinearGraph) -> None:
        send_all(graph.ends, graph.H, graph.g, self._own, self._damping, self.said)

    def beliefs(self) -> Floats:
        """Return precisions and vectors that variables believe in, (n, D, D + 1)."""
        result = self._own.copy()
        np.add.at(result, self._receivers, self.said)
        return result

    def precisions(self, graph: LinearGraph) -> Floats:
        """Return the precisions that variables believe in once these are settled, (n, D, D)."""
        self._take(graph)
        places, before = np.arange(graph.D), np.zeros_like(graph.scales)
        for _ in range(self.most_rounds):
            self._send(graph)
            graph.rounds += 1
            beliefs = self.beliefs()[..., :-1]
            now = beliefs[:, places, places]
            if np.all(np.abs(now - before) <= _SETTLED * now):
                break
            before = now
        return beliefs

    def shift(self, increments: Floats) -> None:
        """Say of the moved variables what was said of them before."""
        if self.said.size:
            moved = increments[self._receivers]
            self.said[..., -1] -= np.einsum("mij,mj->mi", self.said[..., :-1], moved)


class Residual(Synchronous):
    """The variable speaks that heard the most since it spoke last."""

    def _take(self, graph: LinearGraph) -> None:
        """Take the numbers of a graph; all speak once."""
        super()._take(graph)
        self._residuals = np.full(graph.graph.size, np.inf)

    def _send(self, graph: LinearGraph) -> None:
        send_by_residual(
            graph.ends, graph.H, graph.g, self._own, self._damping, self.said, graph.senders.starts,
            graph.senders.outgoing, graph.scales, self._residuals,
        )  # fmt: skip
