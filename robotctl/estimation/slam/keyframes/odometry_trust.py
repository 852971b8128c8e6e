"""Whether odometry can be believed: scans notice a blocked wheel or a dead encoder."""

from __future__ import annotations

from collections import deque

from robotctl.estimation.slam_tuning import TrustConfig


class OdometryTrust:
    """Believes odometry until scans contradict it, and again when both agree for a while.

    Attributes
    ----------
    is_trusted
        Whether odometry predicts the motion.
    losses
        Number of times that it was left out.
    """

    def __init__(self, config: TrustConfig) -> None:
        self._config = config
        self._contradicted: deque[bool] = deque(maxlen=config.of_last)
        self._agreed_m = 0.0
        self.is_trusted = True
        self.losses = 0

    def judge(self, *, contradicts: bool, moved_m: float) -> None:
        """Take in whether a scan contradicts odometry, after a motion by the scan [m]."""
        self._contradicted.append(contradicts)
        if self.is_trusted:
            if sum(self._contradicted) >= self._config.contradictions:
                self.is_trusted = False
                self.losses += 1
                self._agreed_m = 0.0
            return
        # At rest all odometry agrees, a dead one too.
        self._agreed_m = 0.0 if contradicts else self._agreed_m + moved_m
        if self._agreed_m >= self._config.agreed_m:
            self.begin()

    def begin(self) -> None:
        """Believe odometry, as at the start."""
        self.is_trusted = True
        self._contradicted.clear()
