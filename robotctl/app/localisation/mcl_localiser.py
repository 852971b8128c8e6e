"""Monte Carlo localisation in the navigation process."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.app.localisation.localiser import (
    LocaliserBegin,
    LocaliserInput,
    MadeLocaliser,
    external_covariance,
    localisation_state,
    sensed_robot,
)
from robotctl.app.localisation.map_sensors import MapSensors
from robotctl.app.localisation.place_watch import Fix, PlaceWatch, load_place_watch
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_area_m2, free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.mcl.map_symmetry import symmetries
from robotctl.estimation.mcl.remembered import Remembered
from robotctl.estimation.mcl.search_size import search_size, too_large
from robotctl.estimation.mcl.sliced import Work
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.ranging.log_likelihood import LogLikelihood
from robotctl.estimation.sensor_names import SONAR
from robotctl.messages.control import ControlState, ExternalPose
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarReading

_OUTSIDE: Final = "outside"
_PLACE: Final = "place"
_FITS_NOWHERE: Final = (
    "what the robot sees matches no place on the map: is it the right map, and up to date?"
)


class MclLocaliser:
    """Moves the particles to the time of each measurement, then weighs them by it.

    Parameters
    ----------
    mcl
        The particles, where they start.
    sensors
        Likelihoods of what they measure.
    settings
        Sensors that are listened to, and the uncertainty of poses from outside.
    history
        History of the odometry; kept up to date by the caller.
    places
        Recognises places; None: it knows none.
    """

    def __init__(
        self,
        mcl: MonteCarloLocaliser,
        sensors: MapSensors,
        settings: LocalisationConfig,
        history: OdometryHistory,
        places: PlaceWatch | None = None,
    ) -> None:
        self._mcl = mcl
        self._sensors = sensors
        self._settings = settings
        self._history = history
        self._places = places
        self._fitted_nowhere = False
        self._blind_ns = round(1e9 * mcl.config.blind_s)
        self._at: tuple[int, SE2] | None = None
        """Time and odometry pose that the particles stand at."""
        self._work = Work()
        self._late = Remembered()
        """Places that were recognised meanwhile: robots seldom turn at one, so they wait."""

    @property
    def particles(self) -> NDArray[np.float64]:
        """Particles, (n, 3) [m, m, rad]."""
        return self._mcl.poses

    def begin_odometry(self) -> None:
        """Keep the belief; the next control state's odometry is another one."""
        self._at = None

    def take_notices(self) -> list[str]:
        """Return which places were recognised since the last call, and whether no place fits."""
        notices = [] if self._places is None else self._places.take_notices()
        if self._mcl.fits_nowhere and not self._fitted_nowhere:
            notices.append(_FITS_NOWHERE)
        self._fitted_nowhere = self._mcl.fits_nowhere
        return notices

    def step(self, control: ControlState, seen: LocaliserInput, now_ns: int) -> LocalisationState:
        """Process everything since the last step; return the present estimate."""
        if self._at is None:
            self._at = (control.stamp_ns, control.T_odom_base)
        left = self._work.go_on(self._mcl.config.search.poses_per_step)
        for stamp_ns, sensor, measurement in sorted(self._measurements(seen), key=itemgetter(0, 1)):
            if not self._move_to(stamp_ns):
                continue
            has_time = left > 0 and not self._work.is_under_way
            if has_time and self._mcl.due(sensor):
                left = self._begin(measurement(), sensor, left)
            elif not has_time and sensor == _PLACE:
                self._late.add(measurement())
        if len(self._late) and left > 0 and not self._work.is_under_way:
            late, self._late = self._late, Remembered()
            self._begin(late, _PLACE, left)
        # Without measurements the belief still moves, and reports that it fades.
        self._move_to(control.stamp_ns - self._blind_ns)
        state = localisation_state("mcl", self._mcl.estimate(self._at[0]), self._at[1], now_ns)
        return msgspec.structs.replace(
            state, particles=len(self._mcl.poses), tracked=self._mcl.is_tracked
        )

    def _begin(self, measurement: LogLikelihood, sensor: str, left: int) -> int:
        """Begin with a measurement, as `Work.go_on`."""
        return self._work.begin(self._mcl.measuring(measurement, sensor), left)

    def _measurements(
        self, seen: LocaliserInput
    ) -> Iterator[tuple[int, str, Callable[[], LogLikelihood]]]:
        """Yield what was measured when, by which sensor, and what makes a measurement of it."""
        sensors = self._sensors
        for name, measured in seen.measured.items():
            for each in measured if name in self._settings.sensors else ():
                source = sensors.source(name, each)
                yield each.stamp_ns, source, partial(sensors.measurement, name, each)
        for fix in self._recognised(seen.measured.get(SONAR, ())):
            yield fix.stamp_ns, _PLACE, partial(_given, fix.log_likelihood)
        for pose in seen.poses:
            yield pose.stamp_ns, _OUTSIDE, partial(pose_measurement, pose, self._settings)

    def _recognised(self, readings: Sequence[SonarReading]) -> Iterator[Fix]:
        """Yield what places say that the robot has turned at."""
        if self._places is None:
            return
        for reading in readings:
            odometry = self._history.at(reading.stamp_ns)
            fix = None if odometry is None else self._places.hear(reading, odometry)
            if fix is not None:
                yield fix

    def _move_to(self, stamp_ns: int) -> bool:
        """Move the particles to a time; False if that is too long ago.

        Slightly late measurements count at the present particles: between two steps a robot moves
        by centimetres. What is newer than the odometry counts at the last pose of that, from which
        the next stretch begins.
        """
        odometry, newest_ns = self._history.at(stamp_ns), self._history.newest_ns
        if odometry is None or newest_ns is None or self._at is None:
            return False
        stamp_ns = min(stamp_ns, newest_ns)
        if stamp_ns > self._at[0]:
            motion = self._at[1].inverse() @ odometry
            self._mcl.move(motion)
            self._late.move(motion)
            self._at = (stamp_ns, odometry)
        return True


def _given(log_likelihood: LogLikelihood) -> LogLikelihood:
    return log_likelihood


def pose_measurement(pose: ExternalPose, settings: LocalisationConfig) -> LogLikelihood:
    """Return the log-likelihood of an external pose: a Gaussian, the heading wrapped."""
    # covariance = L L^T: as a sum of squares the log-likelihood is never above 0.
    whitening = np.linalg.inv(np.linalg.cholesky(external_covariance(pose, settings)))

    def log_likelihood(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        off = poses - (pose.x_m, pose.y_m, pose.theta_rad)
        off[:, 2] = np.arctan2(np.sin(off[:, 2]), np.cos(off[:, 2]))
        logs: NDArray[np.float64] = -0.5 * np.sum((off @ whitening.T) ** 2, axis=1)
        return logs

    return log_likelihood


def make(begin: LocaliserBegin) -> MadeLocaliser:
    """Return the particles of a robot, their kernels compiled or loaded from the cache.

    Raises
    ------
    ConfigError
        If map or places are wrong.
    """
    config, start, world_map = begin.config, begin.start, begin.world_map()
    settings = config.localisation
    known = MclConfig.tuned(settings.mcl)
    mcl_config = replace(
        known,
        max_particles=settings.particles_max,
        motion=replace(known.motion, noise=known.motion.noise.at_least(config.odometry)),
    )
    sensors = MapSensors(world_map, sensed_robot(config))
    free, free_m2 = free_poses(world_map.grid), free_area_m2(world_map.grid)
    tried = MonteCarloLocaliser(mcl_config, free, np.random.default_rng(0))
    _rehearse(tried, sensors.rehearsal(), start)
    size = max(search_size(free_m2, settings.mcl.search), settings.particles_max)
    mcl_config = replace(mcl_config, search_poses=size)
    seeded = np.random.default_rng(settings.seed)
    alike = symmetries(world_map.grid, settings.mcl.search)
    mcl = MonteCarloLocaliser(mcl_config, free, seeded, alike)
    if settings.start == "known":
        mcl.start_at(start, settings.start_sigma_m, math.radians(settings.start_sigma_deg))
    area_m2 = float(world_map.grid.free().sum()) * world_map.grid.resolution_m**2
    places = load_place_watch(settings.places, begin.beside, config.sonar, area_m2)
    localiser = MclLocaliser(mcl, sensors, settings, begin.history, places)
    is_too_large = too_large(free_m2, settings.mcl.search) if settings.start == "unknown" else None
    return MadeLocaliser(localiser, world_map, notices=[is_too_large] if is_too_large else [])


def _rehearse(mcl: MonteCarloLocaliser, measurements: Sequence[LogLikelihood], start: SE2) -> None:
    """Compile by letting unused particles search and track once with each sensor."""
    for measurement in measurements:
        mcl.measure(measurement)
    mcl.start_at(start, 0.1, 0.1)
    for measurement in measurements:
        mcl.move(SE2(0.2, 0.0, 0.1))
        mcl.measure(measurement)
