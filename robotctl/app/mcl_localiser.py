"""Monte Carlo localisation in the navigation process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.app.localiser import SonarNews, external_covariance, localisation_state
from robotctl.app.odometry_history import OdometryHistory
from robotctl.estimation.likelihood_field import LikelihoodField
from robotctl.estimation.log_likelihood import LogLikelihood
from robotctl.estimation.mcl import MonteCarloLocaliser
from robotctl.estimation.sonar_model import SonarModel
from robotctl.model.range_scan import RangeScan
from robotctl.model.se2 import SE2
from robotctl.runtime.messages import ControlState, ExternalPose, LocalisationState

_LIDAR: Final = -1
_EXTERNAL: Final = -2


class MclLocaliser:
    """Moves the particles to the time of each measurement, then weighs them by it.

    Each sensor weighs them once for each piece of way (`MclConfig.update_min_m`): what a robot
    that stands still sees again is nothing new.

    Parameters
    ----------
    mcl
        The particles, where they start.
    field
        What lidar scans say.
    sonars
        What sonars say; None without sonars.
    history
        Of the odometry; whoever steps the localiser keeps it up to date.
    """

    def __init__(
        self,
        mcl: MonteCarloLocaliser,
        field: LikelihoodField,
        sonars: SonarModel | None,
        history: OdometryHistory,
    ) -> None:
        self._mcl = mcl
        self._field = field
        self._sonars = sonars
        self._history = history
        self._news = SonarNews(sonars.config.max_range_m if sonars is not None else 0.0)
        self._at: tuple[int, SE2] | None = None
        """Time and odometry pose that the particles stand at."""
        self._heard: set[int] = set()
        """Sensors that have weighed the particles on this piece of way."""

    @property
    def particles(self) -> NDArray[np.float64]:
        """Particles, (n, 3) [m, m, rad]."""
        return self._mcl.poses

    def step(
        self,
        control: ControlState,
        scans: Sequence[RangeScan],
        poses: Sequence[ExternalPose],
        now_ns: int,
    ) -> LocalisationState:
        """Take in all that came since the last step; return what is believed now."""
        if self._at is None:
            self._at = (control.stamp_ns, SE2(control.x_m, control.y_m, control.theta_rad))
        for stamp_ns, sensor, measurement in sorted(
            self._measurements(control, scans, poses), key=lambda each: each[:2]
        ):
            if self._move_to(stamp_ns):
                self._weigh(sensor, measurement)
        state = localisation_state("mcl", self._mcl.estimate(self._at[0]), self._at[1], now_ns)
        return msgspec.structs.replace(state, particles=len(self._mcl.poses))

    def _measurements(
        self,
        control: ControlState,
        scans: Sequence[RangeScan],
        poses: Sequence[ExternalPose],
    ) -> list[tuple[int, int, Callable[[], LogLikelihood]]]:
        """Return what was measured when, by which sensor, and what makes a measurement of it."""
        found: list[tuple[int, int, Callable[[], LogLikelihood]]] = [
            (scan.stamp_ns, _LIDAR, partial(self._field.measurement, scan)) for scan in scans
        ]
        if self._sonars is not None:
            found += [
                (
                    stamp_ns,
                    int(np.argmin(np.isnan(ranges_m))),
                    partial(self._sonars.measurement, ranges_m),
                )
                for stamp_ns, ranges_m in self._news.take(control)
            ]
        found += [(pose.stamp_ns, _EXTERNAL, partial(pose_measurement, pose)) for pose in poses]
        return found

    def _move_to(self, stamp_ns: int) -> bool:
        """Move the particles to a time; False where that is too long ago.

        What comes a little late counts where they stand: between two steps a robot moves by
        centimetres.
        """
        odometry = self._history.at(stamp_ns)
        if odometry is None or self._at is None:
            return False
        if stamp_ns > self._at[0]:
            self._mcl.move(self._at[1].inverse() @ odometry)
            self._at = (stamp_ns, odometry)
        return True

    def _weigh(self, sensor: int, measurement: Callable[[], LogLikelihood]) -> None:
        """Let a sensor weigh the particles, if it has not done so on this piece of way."""
        if self._mcl.due:
            self._heard.clear()
        if sensor not in self._heard:
            self._heard.add(sensor)
            self._mcl.measure(measurement(), sensor)


def pose_measurement(pose: ExternalPose) -> LogLikelihood:
    """Return what a pose from outside says of poses: a Gaussian, the heading on the circle."""
    information = np.linalg.inv(external_covariance(pose))

    def log_likelihood(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        off = poses - (pose.x_m, pose.y_m, pose.theta_rad)
        off[:, 2] = np.arctan2(np.sin(off[:, 2]), np.cos(off[:, 2]))
        logs: NDArray[np.float64] = -0.5 * np.einsum("ni,ij,nj->n", off, information, off)
        return logs

    return log_likelihood
