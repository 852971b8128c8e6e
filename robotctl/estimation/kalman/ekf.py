"""Pose and velocities by an extended Kalman filter: encoders move it, everything else corrects it.

The state is x, y, theta of `base` in `world`, v and omega, and the bias of a gyro where there is
one. `predict` takes what the encoders counted since the last step, as an input with noise: the
pose moves along the arc, v and omega become the means of the step, and since one noise moves both,
a gyro that corrects omega corrects the heading too. Without encoders `coast` keeps the velocities.

Measurements may come late, and in any order: each has the time at which it was true. The filter
keeps its states and inputs for a while, goes back, cuts the motion at that time, takes the
measurement in and goes forward again, so the result is that of a measurement that came in time. One
that is ahead of the encoders waits for them.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.consistency import InnovationWindow
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.kalman.ekf_models import (
    bearing_residual,
    landmark_sighting,
    pose_residual,
    wall_range,
)
from robotctl.estimation.kalman.ekf_motion import coasted, moved
from robotctl.estimation.kalman.robust_kalman import Innovation, Residual, RobustKalman
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap

Array: TypeAlias = NDArray[np.float64]
_Expectation: TypeAlias = Callable[[Array], tuple[Array, Array] | None]
"""Function from a state to the expected measurement (m,) and its Jacobian (m, first k states)."""


@dataclass(frozen=True, slots=True)
class _Motion:
    """Motion from one time to another; `distance_m` None: no encoder counts."""

    begin_ns: int
    end_ns: int
    distance_m: float | None
    turn_rad: float

    def cut(self, stamp_ns: int) -> tuple[_Motion, _Motion]:
        """Return the parts before and after a time inside of it."""
        share = (stamp_ns - self.begin_ns) / (self.end_ns - self.begin_ns)
        whole, turn = self.distance_m, self.turn_rad
        first = None if whole is None else share * whole
        second = None if whole is None else (1.0 - share) * whole
        return (
            _Motion(self.begin_ns, stamp_ns, first, share * turn),
            _Motion(stamp_ns, self.end_ns, second, (1.0 - share) * turn),
        )


@dataclass(frozen=True, slots=True)
class _Measurement:
    """A sensor's measurement at one time."""

    end_ns: int
    sensor: str
    z: Array
    R: Array
    expectation: _Expectation
    residual: Residual


@dataclass(frozen=True, slots=True)
class _Step:
    """A motion or measurement and the state before it."""

    x: Array
    P: Array
    what: _Motion | _Measurement


class PoseEkf:
    """Extended Kalman filter of a wheeled robot's pose and velocities.

    It follows one belief: started without a clue, or carried away further than its sensors can
    tell, it says LOST and needs `reset` or a pose fix.

    Parameters
    ----------
    config
        Noises and limits.
    start
        Prior of the pose.
    """

    def __init__(self, config: EkfConfig, start: PoseEstimate) -> None:
        self._config = config
        self._window = InnovationWindow(config.window)
        self._keep_ns = round(config.history_s * 1e9)
        self._steps: deque[_Step] = deque()
        self._waiting: list[_Measurement] = []
        self.too_late = 0
        """Measurements that were left out because they came after `history_s`."""
        self._size = 6 if config.gyro else 5
        self._kalman = RobustKalman(np.zeros(self._size), np.eye(self._size), config.robust)
        self.reset(start)

    def reset(self, start: PoseEstimate) -> None:
        """Restart at rest at a pose, with its covariance and time.

        Raises
        ------
        ValueError
            If the covariance is not that of a pose.
        """
        c = self._config
        x, P = np.zeros(self._size), np.zeros((self._size, self._size))
        x[:3] = start.pose.x_m, start.pose.y_m, wrap_angle(start.pose.theta_rad)
        P[:3, :3] = checked_covariance(start.covariance)
        P[3, 3], P[4, 4] = c.velocity_sigma_m_s**2, c.turn_rate_sigma_rad_s**2
        if c.gyro:
            P[5, 5] = c.gyro_bias_sigma_rad_s**2
        self._kalman.set(x, P)
        self._stamp_ns = self._oldest_ns = start.stamp_ns
        self._steps.clear()
        self._waiting.clear()
        self._window.reset()

    @property
    def x(self) -> Array:
        """State: x [m], y [m], theta [rad], v [m/s], omega [rad/s], gyro bias [rad/s]."""
        return self._kalman.x.copy()

    @property
    def P(self) -> Array:
        """Covariance of the state."""
        return self._kalman.P.copy()

    @property
    def nis_per_dof(self) -> float:
        """Mean NIS of the last innovations per degree of freedom, about 1; nan before any."""
        return self._window.nis_per_dof

    @property
    def stamp_ns(self) -> int:
        """Time of the state [ns]."""
        return self._stamp_ns

    def estimate(self) -> PoseEstimate:
        """Return the pose estimate with covariance."""
        x, y, theta = (float(value) for value in self._kalman.x[:3])
        covariance = self._kalman.P[:3, :3].copy()
        if self._window.contradicted:
            status = LocalisationStatus.LOST
        elif covariance[0, 0] + covariance[1, 1] > 2.0 * self._config.searching_sigma_m**2:
            status = LocalisationStatus.SEARCHING
        else:
            status = LocalisationStatus.LOCALISED
        return PoseEstimate(self._stamp_ns, SE2(x, y, wrap_angle(theta)), covariance, status)

    def predict(self, stamp_ns: int, distance_m: float, turn_rad: float) -> list[Innovation]:
        """Move until a time [ns] by what the encoders counted: an arc of a length and a turn.

        Returns
        -------
        Innovations of the measurements that had waited for this.

        Raises
        ------
        ValueError
            If the time goes back or a number is not finite.
        """
        if not (math.isfinite(distance_m) and math.isfinite(turn_rad)):
            raise ValueError(f"increment must be finite, found {distance_m} m, {turn_rad} rad")
        return self._move(_Motion(self._stamp_ns, stamp_ns, distance_m, turn_rad))

    def coast(self, stamp_ns: int) -> list[Innovation]:
        """Move until a time [ns] with the present velocities, where no encoder tells.

        Returns and raises as `predict`.
        """
        return self._move(_Motion(self._stamp_ns, stamp_ns, None, 0.0))

    def update_velocities(
        self, stamp_ns: int, v_m_s: float, omega_rad_s: float, R: Array
    ) -> Innovation | None:
        """Correct v and omega by encoders read as velocities, R (2, 2).

        For encoders that were not counted by `predict` too: using it twice would count it twice.
        """
        H = np.zeros((2, self._size))
        H[0, 3] = H[1, 4] = 1.0
        z = np.array([v_m_s, omega_rad_s])
        return self._measure(stamp_ns, "velocities", z, R, lambda x: (x[3:5], H), np.subtract)

    def update_gyro(self, stamp_ns: int, rate_rad_s: float) -> Innovation | None:
        """Correct omega, heading and bias by the mean turn rate over the last step [rad/s].

        Raises
        ------
        ValueError
            If the configuration has no gyro, or the number is not finite.
        """
        if not self._config.gyro:
            raise ValueError("gyro: false in the configuration, a reading came")
        H = np.zeros((1, self._size))
        H[0, 4] = H[0, 5] = 1.0
        z, R = np.array([rate_rad_s]), np.array([[self._config.gyro_sigma_rad_s**2]])
        return self._measure(stamp_ns, "gyro", z, R, lambda x: (x[4:5] + x[5:6], H), np.subtract)

    def update_sonar(
        self, stamp_ns: int, mount: SonarMount, range_m: float, walls: WallMap
    ) -> Innovation | None:
        """Correct the pose by the range from a sonar to the wall before it [m].

        Nothing happens without an echo (inf, nan), or where the map expects none.
        """
        if not math.isfinite(range_m):
            return None
        sonar = self._config.sonar
        sigma_m = sonar.sigma_m + sonar.sigma_per_m * range_m

        def expectation(x: Array) -> tuple[Array, Array] | None:
            found = wall_range(_pose(x), mount, walls, sonar)
            return None if found is None else (np.array([found[0]]), found[1][None, :])

        z, R = np.array([range_m]), np.array([[sigma_m**2]])
        return self._measure(stamp_ns, f"sonar {mount.name}", z, R, expectation, np.subtract)

    def update_landmark(
        self,
        stamp_ns: int,
        landmark_world: tuple[float, float],
        range_m: float,
        bearing_rad: float,
    ) -> Innovation | None:
        """Correct the pose by range [m] and bearing [rad] of a known landmark."""
        c = self._config
        sigma_m = c.landmark_range_sigma_m + c.landmark_range_sigma_m_per_m * range_m
        R = np.diag([sigma_m**2, c.landmark_bearing_sigma_rad**2])
        return self._measure(
            stamp_ns,
            "landmark",
            np.array([range_m, bearing_rad]),
            R,
            lambda x: landmark_sighting(_pose(x), landmark_world),
            bearing_residual,
        )

    def update_pose(
        self, stamp_ns: int, pose: SE2, covariance: Array, sensor: str = "pose"
    ) -> Innovation | None:
        """Correct by a pose in `world` with its covariance (3, 3): of MCL, or from outside.

        Raises
        ------
        ValueError
            If the covariance is not that of a pose.
        """
        z = np.array([pose.x_m, pose.y_m, pose.theta_rad])
        R, H = checked_covariance(covariance), np.eye(3)
        return self._measure(stamp_ns, sensor, z, R, lambda x: (x[:3], H), pose_residual)

    def _measure(
        self,
        stamp_ns: int,
        sensor: str,
        z: Array,
        R: Array,
        expectation: _Expectation,
        residual: Residual,
    ) -> Innovation | None:
        """Take a measurement in at its time; None: it waits, comes too late, or says nothing."""
        if not np.all(np.isfinite(z)):
            raise ValueError(f"{sensor}: a measurement must be finite, found {z.tolist()}")
        measurement = _Measurement(stamp_ns, sensor, z, R, expectation, residual)
        # Newer than the state: it waits for the odometry that moves the state to its time.
        if stamp_ns > self._stamp_ns:
            insort(self._waiting, measurement, key=lambda each: each.end_ns)
            return None
        if stamp_ns < self._oldest_ns:
            self.too_late += 1
            return None
        # A late measurement: return to the state before its time, apply it, then apply again what
        # came after it.
        again: list[_Motion | _Measurement] = []
        while self._steps and self._steps[-1].what.end_ns > stamp_ns:
            step = self._steps.pop()
            self._kalman.set(step.x, step.P)
            again.append(step.what)
        # The measurement may lie within a motion: that is cut in two at its time.
        first = again[-1] if again else None
        if isinstance(first, _Motion) and first.begin_ns < stamp_ns:
            before, again[-1] = first.cut(stamp_ns)
            self._take(before)
        innovation = self._take(measurement)
        while again:
            self._take(again.pop())
        return self._published(innovation)

    def _move(self, motion: _Motion) -> list[Innovation]:
        """Take a motion in, cut where measurements waited for it."""
        if motion.end_ns < motion.begin_ns:
            raise ValueError(
                f"time goes back: {motion.end_ns} ns after {motion.begin_ns} ns, the state's time"
            )
        # A motion in no time would need an infinite velocity.
        if motion.end_ns == motion.begin_ns and (motion.distance_m or motion.turn_rad):
            raise ValueError(f"motion without time at {motion.end_ns} ns")
        found = []
        while self._waiting and self._waiting[0].end_ns <= motion.end_ns:
            measurement = self._waiting.pop(0)
            if motion.begin_ns < measurement.end_ns < motion.end_ns:
                before, motion = motion.cut(measurement.end_ns)
                self._take(before)
            elif motion.begin_ns < measurement.end_ns:
                self._take(motion)
                motion = replace(motion, begin_ns=motion.end_ns, distance_m=0.0, turn_rad=0.0)
            found.append(self._published(self._take(measurement)))
        if motion.end_ns > motion.begin_ns:
            self._take(motion)
        self._stamp_ns = motion.end_ns
        while self._steps and self._steps[0].what.end_ns < self._stamp_ns - self._keep_ns:
            self._oldest_ns = self._steps.popleft().what.end_ns
        return [each for each in found if each is not None]

    def _published(self, innovation: Innovation | None) -> Innovation | None:
        """Count an innovation that is new."""
        if innovation is not None:
            self._window.add(innovation)
        return innovation

    def _take(self, what: _Motion | _Measurement) -> Innovation | None:
        """Apply a motion or measurement to the present state, and remember the state before it."""
        kalman = self._kalman
        self._steps.append(_Step(kalman.x, kalman.P, what))
        if isinstance(what, _Motion):
            dt_s = (what.end_ns - what.begin_ns) * 1e-9
            if what.distance_m is None:
                kalman.predict(*coasted(kalman.x, dt_s, self._config))
            else:
                kalman.predict(*moved(kalman.x, what.distance_m, what.turn_rad, dt_s, self._config))
            return None
        expected = what.expectation(kalman.x)
        if expected is None:
            return None
        h, H = expected
        # Models of the pose return columns for the pose only; velocities and bias get zeros.
        if H.shape[1] < self._size:
            H = np.concatenate([H, np.zeros((len(H), self._size - H.shape[1]))], axis=1)
        nis, weight = kalman.update(what.z, h, H, what.R, what.residual)
        return Innovation(what.end_ns, what.sensor, nis, len(what.z), weight)


def _pose(x: Array) -> SE2:
    """Return the pose in a state."""
    return SE2(float(x[0]), float(x[1]), float(x[2]))


def checked_covariance(covariance: Array) -> Array:
    """Return the covariance of a pose, (3, 3), symmetric and positive.

    Raises
    ------
    ValueError
        If it is invalid.
    """
    if covariance.shape != (3, 3) or not np.all(np.isfinite(covariance)):
        raise ValueError(f"covariance must be (3, 3) and finite, found {covariance.tolist()}")
    symmetric: Array = 0.5 * (covariance + covariance.T)
    least = float(np.linalg.eigvalsh(symmetric)[0])
    # Rounding may leave a matrix slightly asymmetric; more than that is an error of the sender.
    if not np.allclose(symmetric, covariance, rtol=1e-6, atol=1e-12) or least <= 0.0:
        raise ValueError(
            f"covariance must be symmetric with positive eigenvalues, found {covariance.tolist()}"
        )
    return symmetric
