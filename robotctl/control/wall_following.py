"""Wall following with a sideways-looking sonar.

Geometry: z is the distance to the wall, theta the heading relative to the wall's direction
(positive turned to the left), side = +1 for a wall on the left, -1 on the right. Then::

    dz/dt = -side v sin(theta),    d(theta)/dt = omega

so a robot too far from a left wall must turn left: omega = side (...)(z - d), which is the sign of
v_R - v_L = kp (z - d), for a wall on the left.

Stability: with omega = side k e, e = z - d, this is e'' = -v k e, a double integrator in a
proportional loop. In theory it oscillates for ever, and grows with any delay. `wheel_speeds` is
that law, from Davison's lectures (Robotics, Imperial College London), for comparison.
`WallFollower` adds damping. It is written over the path length (one dash: per metre), so that the
path does not depend on the speed::

    curvature = side (kp e + kd e'),    e' = -side sin(theta)    =>    e'' + kd e' + kp e = 0

With kp = 1 / length^2 and kd = 2 / length it is critically damped: the error falls as (1 + x /
length) exp(-x / length) over the distance x. Derived from the same idea as the curvature
controllers of C. Samson, "Control of chained systems", IEEE Trans. Automatic Control 40(1), 1995.

The heading is not measured. An observer predicts distance and heading by dead reckoning and
corrects both with each reading; it also bridges lost echoes and rejects outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from robotctl.errors import InvalidValue

Side = Literal["left", "right"]

_MIN_PATH_M: Final = 1e-6
_DISTANCE_FILTER_S: Final = 0.5
"""Time constant of the distance correction of a robot at rest [s]."""


class WallGains(NamedTuple):
    """Gains of a critically damped approach."""

    kp: float
    kd: float


def critically_damped(length_m: float) -> WallGains:
    """Return kp [rad/m^2] and kd [rad/m] for a convergence length > 0 [m].

    Raises
    ------
    ValueError
        If the length is not positive and finite.
    """
    if not 0.0 < length_m < math.inf:
        raise InvalidValue("length_m", f"{length_m} found, a finite number > 0 allowed", length_m)
    return WallGains(1.0 / length_m**2, 2.0 / length_m)


class WheelSpeeds(NamedTuple):
    """Speeds of the wheels over the ground [m/s]."""

    left_m_s: float
    right_m_s: float


def wheel_speeds(
    v_m_s: float, range_m: float, distance_m: float, kp: float, side: Side = "left"
) -> WheelSpeeds:
    """Return v_C -+ kp (z - d) / 2 for the left and right wheel: the textbook's law, undamped.

    Parameters
    ----------
    v_m_s
        Speed v_C of the centre [m/s].
    range_m, distance_m
        Measured and desired distance to the wall [m].
    kp
        Gain [1/s]; the loop oscillates at sqrt(v kp / track width) rad/s.
    side
        Side of the wall; "right" is the mirror image of "left".
    """
    half = 0.5 * kp * (range_m - distance_m)
    if side == "right":
        half = -half
    return WheelSpeeds(v_m_s - half, v_m_s + half)


@dataclass(frozen=True, slots=True)
class WallFollowConfig:
    """Configuration of a wall follower.

    Parameters
    ----------
    side
        Side of wall and sonar: "left" or "right".
    distance_m
        Desired distance of `base` to the wall [m], > 0.
    kp, kd
        Gains [rad/m^2, rad/m], > 0; see `critically_damped`. The defaults are those of 0.5 m.
    omega_max_rad_s
        Bound of the turning rate [rad/s], > 0.
    approach_max_rad
        Maximum angle of approach [rad], (0, pi/2): beyond it the echo of a sonar is lost.
    observer_m
        Path length over which a wrong estimate decays [m], > 0.
    range_max_m
        Maximum reading from the wall [m], > distance_m.
    gate_m
        Difference from the expected reading beyond which one is an outlier [m], > 0.
    reacquire_s
        Time for which outliers must agree to become the new wall [s], >= 0.
    lost_after_s
        Time without an accepted reading after which the wall is lost [s], > 0.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    side: Side
    distance_m: float
    kp: float = 4.0
    kd: float = 4.0
    omega_max_rad_s: float = 1.0
    approach_max_rad: float = 0.35
    observer_m: float = 0.25
    range_max_m: float = 2.0
    gate_m: float = 0.15
    reacquire_s: float = 0.3
    lost_after_s: float = 1.0

    def __post_init__(self) -> None:
        if self.side not in ("left", "right"):
            raise InvalidValue("side", f'{self.side!r} found, "left" or "right" allowed', self.side)
        for name in (
            "distance_m",
            "kp",
            "kd",
            "omega_max_rad_s",
            "observer_m",
            "range_max_m",
            "gate_m",
            "lost_after_s",
        ):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise InvalidValue(name, f"{value} found, a finite number > 0 allowed", value)
        if not 0.0 < self.approach_max_rad < math.pi / 2:
            raise InvalidValue(
                "approach_max_rad",
                f"{self.approach_max_rad} found, (0, pi/2) allowed",
                self.approach_max_rad,
            )
        if not 0.0 <= self.reacquire_s < math.inf:
            raise InvalidValue(
                "reacquire_s",
                f"{self.reacquire_s} found, a finite number >= 0 allowed",
                self.reacquire_s,
            )
        if not self.range_max_m > self.distance_m:
            raise InvalidValue(
                "range_max_m",
                f"{self.range_max_m} found, more than distance_m allowed",
                self.range_max_m,
            )


class WallFollower:
    """Keeps a distance to a wall, assumed straight over a few `observer_m`."""

    def __init__(self, config: WallFollowConfig) -> None:
        self.config = config
        self._side = 1.0 if config.side == "left" else -1.0
        self.reset()

    def reset(self) -> None:
        """Forget the wall; the next reading is taken unfiltered, the heading as parallel."""
        self.distance_est_m = math.nan
        self.heading_est_rad = 0.0
        self._unseen_s = math.inf
        self._path_m = 0.0
        self._candidate_m = math.nan
        self._candidate_s = 0.0
        self._omega_rad_s = 0.0

    @property
    def lost(self) -> bool:
        """Whether there is no wall to follow: none so far, or none for `lost_after_s`."""
        return self._unseen_s > self.config.lost_after_s

    def step(
        self, range_m: float, v_m_s: float, dt_s: float, omega_meas_rad_s: float | None = None
    ) -> float:
        """Return the turning rate [rad/s], positive left; 0 while the wall is lost.

        It never raises. It returns 0 and changes nothing for an invalid speed or `dt_s`.

        Parameters
        ----------
        range_m
            Reading of the sideways sonar, from `base` [m]; nan without a new one, inf without an
            echo. The same reading may be repeated until the next one comes.
        v_m_s
            Speed [m/s]; negative drives backwards along the wall.
        dt_s
            Time since the last call [s], > 0.
        omega_meas_rad_s
            Measured turning rate since the last call [rad/s]; None: the one returned then.
        """
        if not (math.isfinite(v_m_s) and 0.0 < dt_s < math.inf):
            return 0.0
        omega = self._omega_rad_s if omega_meas_rad_s is None else omega_meas_rad_s
        self._predict(v_m_s, omega if math.isfinite(omega) else 0.0, dt_s)
        if 0.0 < range_m <= self.config.range_max_m:
            self._take(range_m, v_m_s)
        self._omega_rad_s = 0.0 if self.lost else self._law(v_m_s)
        return self._omega_rad_s

    def _law(self, v_m_s: float) -> float:
        """Return the turning rate for the estimated distance and heading."""
        config = self.config
        pull = config.kp * (self.distance_est_m - config.distance_m)
        # Damping kd sin(heading) balances a pull of this size at the steepest approach.
        pull_max = config.kd * math.sin(config.approach_max_rad)
        pull = min(max(pull, -pull_max), pull_max)
        # Over the path: the pull changes its sign with the direction of travel, damping does not.
        damping = config.kd * math.sin(self.heading_est_rad)
        omega = self._side * pull * v_m_s - damping * abs(v_m_s)
        return min(max(omega, -config.omega_max_rad_s), config.omega_max_rad_s)

    def _predict(self, v_m_s: float, omega_rad_s: float, dt_s: float) -> None:
        """Predict distance and heading by dead reckoning."""
        heading = self.heading_est_rad + 0.5 * omega_rad_s * dt_s
        self.distance_est_m -= self._side * v_m_s * math.sin(heading) * dt_s
        self.heading_est_rad = math.remainder(heading + 0.5 * omega_rad_s * dt_s, math.tau)
        self._path_m += abs(v_m_s) * dt_s
        self._unseen_s += dt_s
        self._candidate_s += dt_s

    def _take(self, range_m: float, v_m_s: float) -> None:
        """Correct the estimate with a reading, unless it is an outlier."""
        config = self.config
        if self.lost:
            # No heading is known from one reading: assume the robot parallel to the wall.
            self.heading_est_rad = 0.0
            self._start(range_m)
            return
        innovation = range_m - self.distance_est_m
        # An outlier: an open door, a person. If such readings agree for long, the wall has moved.
        if abs(innovation) > config.gate_m:
            # nan compares false, so the first outlier starts its own clock.
            if not abs(range_m - self._candidate_m) <= config.gate_m:
                self._candidate_s = 0.0
            self._candidate_m = range_m
            if self._candidate_s >= config.reacquire_s:
                self._start(range_m)
            return
        # Steady-state gains of a critically damped observer over the path since the last reading.
        path_m = self._path_m
        keep = math.exp(-path_m / config.observer_m)
        share = max(1.0 - keep * keep, 1.0 - math.exp(-self._unseen_s / _DISTANCE_FILTER_S))
        self.distance_est_m += share * innovation
        if path_m > _MIN_PATH_M:
            slope = (1.0 - keep) ** 2 * innovation / path_m
            self.heading_est_rad -= self._side * math.copysign(slope, slope * v_m_s)
        self._seen()

    def _start(self, range_m: float) -> None:
        """Take a reading as the distance."""
        self.distance_est_m = range_m
        self._seen()

    def _seen(self) -> None:
        self._unseen_s = 0.0
        self._path_m = 0.0
        self._candidate_m = math.nan
