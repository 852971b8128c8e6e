"""Whether what a robot sees fits any place of its map at all, while it does not know its place.

On the wrong map a search ends somewhere, too. But from the best place that it finds the beams of a
lidar go through walls: of the likelihood of its scans, with what is hidden forgiven, the mean over
twenty is -13 to -24 nat on maps of other buildings, and not below -10 nat where the map was right
(four public logs, in one of which visitors hide half the beams).
"""

from __future__ import annotations

from robotctl.estimation.mcl.tuning import SearchConfig


class Misfit:
    """Mean of how well measurements fit the best place that is known.

    Parameters
    ----------
    config
        When nothing fits.
    """

    def __init__(self, config: SearchConfig | None = None) -> None:
        self._config = config or SearchConfig()
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self._count = 0
        self._mean = 0.0

    def add(self, log_likelihood: float) -> None:
        """Add a tolerant sensor's log-likelihood of the best place [nat]."""
        self._count += 1
        self._mean += (log_likelihood - self._mean) / min(self._count, self._config.fit_memory)

    @property
    def is_bad(self) -> bool:
        """Whether nothing fits, for long enough."""
        config = self._config
        return self._count >= config.fit_measurements and self._mean < config.fit_min
