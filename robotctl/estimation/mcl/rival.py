"""A rival of the tracked place: a parallel search that must prove itself over motion.

A wrong place may fit better than the right one: people hide the walls, a door stands open, a corner
looks like another. Such a place fits one scan, or some; it does not go along with the robot. So the
tracked belief is kept while a second one searches the map for a better place, both are moved and
weighed by the same odometry and measurements, and each predicts how likely the next measurement is.
The difference of these log-evidences, summed over some distance, is the Bayes factor between the
two.
"""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.belief import Cluster
from robotctl.estimation.mcl.look_alikes import are_apart
from robotctl.estimation.mcl.particle_belief import ParticleBelief


class RivalVerdict(enum.Enum):
    """State of a rival."""

    OPEN = enum.auto()
    REFUTED = enum.auto()
    """The tracked place explains the measurements better, or the rival is the same place."""
    PROVEN = enum.auto()


class Rival:
    """A belief in another place.

    Parameters
    ----------
    belief
        The search.
    """

    def __init__(self, belief: ParticleBelief) -> None:
        self.belief = belief
        self._config = belief.config.rival
        self._was_compact = False
        self._begin()

    def _begin(self) -> None:
        self.lead = 0.0
        """Log-evidence of the rival less that of the tracked belief, since both are compared."""
        self._distance_m = 0.0
        self._angle_rad = 0.0
        self._measurements = 0

    def compare(
        self, lead: float, distance_m: float, angle_rad: float, tracked: Cluster
    ) -> RivalVerdict:
        """Add how much better the rival predicted a measurement, after some motion.

        Once the rival is compact its lead restarts, because it was fitted to what the search saw.

        Parameters
        ----------
        lead
            Log-evidence of the rival less that of the tracked belief [nat].
        distance_m, angle_rad
            Distance since the last measurement [m], and the turns on it [rad].
        tracked
            The heaviest cluster of the tracked belief.
        """
        config = self._config
        is_compact = self.belief.agreed > 0
        if is_compact != self._was_compact:
            self._was_compact = is_compact
            self._begin()
            return RivalVerdict.OPEN
        # Clipped, so that one wild measurement decides nothing.
        self.lead += min(max(lead, -config.clip), config.clip)
        self._distance_m += distance_m
        self._angle_rad += angle_rad
        self._measurements += 1
        moved = self._distance_m >= config.travel_min_m or self._angle_rad >= config.turn_min_rad
        # A wrong place may fit better while the robot stands: people hide walls, a corner resembles
        # another.
        if not moved or self._measurements < config.measurements_min:
            return RivalVerdict.OPEN
        if self.lead < -config.lead:
            return RivalVerdict.REFUTED
        if not self.belief.is_sure:
            return RivalVerdict.OPEN
        # The search ended in the tracked place, so the alarm was false.
        if not are_apart(self._place(), tracked, self.belief.config.search)[0]:
            return RivalVerdict.REFUTED
        return RivalVerdict.PROVEN if self.lead > config.lead else RivalVerdict.OPEN

    def _place(self) -> NDArray[np.float64]:
        """Return the middle of the heaviest cluster, (1, 3)."""
        mean = self.belief.best.mean
        return np.array([[mean.x_m, mean.y_m, mean.theta_rad]])
