"""Whether what a robot sees fits any place of its map at all, while it does not know its place.

On the wrong map a search ends somewhere, too. But from the best place that it finds the beams of a
lidar go through walls: of the likelihood of its scans, with what is hidden forgiven, the mean over
twenty is -13 to -24 nat on maps of other buildings, and not below -10 nat where the map was right
(four public logs, in one of which visitors hide half the beams).
"""

from __future__ import annotations

from typing import Final

_MEMORY: Final = 20
"""Measurements over which the fit is averaged."""
_ENOUGH: Final = 10
"""With fewer there is no verdict."""
_LEAST: Final = -11.0
"""Mean log-likelihood of a map that may be right [nat]."""


class Misfit:
    """Mean of how well measurements fit the best place that is known."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self._count = 0
        self._mean = 0.0

    def add(self, log_likelihood: float) -> None:
        """Add a tolerant sensor's log-likelihood of the best place [nat]."""
        self._count += 1
        self._mean += (log_likelihood - self._mean) / min(self._count, _MEMORY)

    @property
    def is_bad(self) -> bool:
        """Whether nothing fits, for long enough."""
        return self._count >= _ENOUGH and self._mean < _LEAST
