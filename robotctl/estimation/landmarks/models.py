"""Models of an odometry and a camera that are not calibrated, with their calibration as state.

Data sheets and logs of a robot are seldom quite right, and an EKF that trusts them is too sure of a
wrong pose. So the errors that do not average out are states, estimated along with the pose
(self-calibration by an augmented filter: Martinelli, Tomatis, Siegwart: Simultaneous localization
and odometry self calibration for mobile robot, Autonomous Robots 22, 2007; the terms of the
odometry are those of Roy and Thrun: Online self-calibration for mobile robots, ICRA 1999, the lag
that of Qin and Shen: Online temporal calibration, IROS 2018).

Odometry reports a distance d and a turn a; the robot moved

    d' = (1 + distance_scale) d - slip |a|      (wheels scrub in turns; only while driving)
    a' = (1 + turn_scale) a + drift d           (left and right turns each have their scale)

of a time that lies `delay` back: what a log calls odometry is often the command, and a drive
follows it later.

A camera at (arm_x, arm_y) of `base` sees a landmark at distance r and direction phi; it reports

    range = range_offset + (1 + range_scale) r (1 - depth_share (1 - cos(phi - axis)))
    bearing = bearing_offset + wander + (1 + bearing_scale) phi

`depth_share` 0 is the distance; 1 the depth along the optical axis, which is what the height of a
landmark in an image gives. Which of the two a log means, it seldom says; the filter finds it out.
`wander` is what moves slowly in the mount, a first-order Gauss-Markov process.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.geometry.angles import wrap_angle

Array: TypeAlias = NDArray[np.float64]


class S(enum.IntEnum):
    """Index of each state; lengths [m], angles [rad], delay [s]."""

    X = 0
    Y = 1
    THETA = 2
    DISTANCE_SCALE = 3
    SLIP = 4
    LEFT_SCALE = 5
    RIGHT_SCALE = 6
    DRIFT = 7
    DELAY = 8
    RANGE_OFFSET = 9
    RANGE_SCALE = 10
    DEPTH_SHARE = 11
    AXIS = 12
    BEARING_OFFSET = 13
    BEARING_SCALE = 14
    ARM_X = 15
    ARM_Y = 16
    WANDER = 17


_OFFSET, _SCALE = int(S.RANGE_OFFSET), int(S.RANGE_SCALE)
_DEPTH, _AXIS = int(S.DEPTH_SHARE), int(S.AXIS)
_TURNED, _TURN_SCALE = int(S.BEARING_OFFSET), int(S.BEARING_SCALE)
_ARM_X, _ARM_Y, _WANDER = int(S.ARM_X), int(S.ARM_Y), int(S.WANDER)


@dataclass(frozen=True, slots=True)
class OdometryReading:
    """Odometry up to a time, and its rate then.

    Parameters
    ----------
    distance_m, turn_rad
        Since its start [m], [rad].
    v_m_s, omega_rad_s
        Velocities [m/s], [rad/s].
    """

    distance_m: float
    turn_rad: float
    v_m_s: float
    omega_rad_s: float


def moved(
    x: Array, begin: OdometryReading, end: OdometryReading
) -> tuple[Array, Array, Array, float, float]:
    """Return the state after what odometry counted between two readings.

    Returns
    -------
    The state, its Jacobian F (n, n) by the state, that of the pose by corrected distance and
    turn G (3, 2), and the two themselves [m], [rad].
    """
    d0, a0 = end.distance_m - begin.distance_m, end.turn_rad - begin.turn_rad
    scale = S.LEFT_SCALE if a0 >= 0.0 else S.RIGHT_SCALE
    slipping = math.copysign(1.0, d0 * a0) if d0 != 0.0 else 0.0
    d = (1.0 + x[S.DISTANCE_SCALE]) * d0 - x[S.SLIP] * slipping * a0
    a = (1.0 + x[scale]) * a0 + x[S.DRIFT] * d0
    half = x[S.THETA] + 0.5 * a
    c, s = math.cos(half), math.sin(half)
    G = np.array([[c, -0.5 * d * s], [s, 0.5 * d * c], [0.0, 1.0]])
    by_state = np.zeros((2, len(x)))
    by_state[0, S.DISTANCE_SCALE] = d0
    by_state[0, S.SLIP] = -slipping * a0
    by_state[1, scale] = a0
    by_state[1, S.DRIFT] = d0
    # more delay takes away what was counted last and adds what was counted before
    more_d, more_a = begin.v_m_s - end.v_m_s, begin.omega_rad_s - end.omega_rad_s
    by_state[0, S.DELAY] = (1.0 + x[S.DISTANCE_SCALE]) * more_d - x[S.SLIP] * slipping * more_a
    by_state[1, S.DELAY] = (1.0 + x[scale]) * more_a + x[S.DRIFT] * more_d
    F = np.eye(len(x))
    F[0, S.THETA], F[1, S.THETA] = -d * s, d * c
    F[:3] += G @ by_state
    after = x.copy()
    after[:3] += d * c, d * s, a
    after[S.THETA] = wrap_angle(float(after[S.THETA]))
    return after, F, G, float(d), float(a)


def sighting(x: Array, landmark_world: tuple[float, float]) -> tuple[Array, Array, float]:
    """Return expected (range [m], bearing [rad]), H (2, n), and the distance from the camera [m].

    Not defined with the camera on the landmark.
    """
    z, by_robot, _ = sightings(x, np.array([landmark_world]))
    c, s = math.cos(x[S.THETA]), math.sin(x[S.THETA])
    dx, dy = landmark_world[0] - x[S.X], landmark_world[1] - x[S.Y]
    distance_m = math.hypot(c * dx + s * dy - x[S.ARM_X], -s * dx + c * dy - x[S.ARM_Y])
    return z[0], by_robot[0], distance_m


@compiled
def sightings(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return expected ranges [m] and bearings [rad] of points (k, 2), and their Jacobians.

    Returns
    -------
    Expected (k, 2), and its Jacobians by the state (k, 2, n) and by the point (k, 2, 2).
    """
    count = len(y)
    z, by_point = np.empty((count, 2)), np.empty((count, 2, 2))
    by_robot = np.zeros((count, 2, len(x)))
    c, s = math.cos(x[2]), math.sin(x[2])
    scale, turn_scale = 1.0 + x[_SCALE], 1.0 + x[_TURN_SCALE]
    for k in range(count):
        dx, dy = y[k, 0] - x[0], y[k, 1] - x[1]
        bx, by = c * dx + s * dy, -s * dx + c * dy
        qx, qy = bx - x[_ARM_X], by - x[_ARM_Y]
        r, phi = math.hypot(qx, qy), math.atan2(qy, qx)
        off = phi - x[_AXIS]
        lost = 1.0 - math.cos(off)
        shape = 1.0 - x[_DEPTH] * lost
        turn = -scale * r * x[_DEPTH] * math.sin(off)
        z[k, 0] = x[_OFFSET] + scale * shape * r
        z[k, 1] = x[_TURNED] + x[_WANDER] + turn_scale * phi
        H = by_robot[k]
        # by the point's place in the camera, then by what moves that
        ux, uy = qx / r, qy / r
        h = np.array(
            [
                [scale * shape * ux - turn * uy / r, scale * shape * uy + turn * ux / r],
                [-turn_scale * uy / r, turn_scale * ux / r],
            ]
        )
        for q in range(2):
            H[q, 0] = -h[q, 0] * c + h[q, 1] * s
            H[q, 1] = -h[q, 0] * s - h[q, 1] * c
            H[q, 2] = h[q, 0] * by - h[q, 1] * bx
            H[q, _ARM_X], H[q, _ARM_Y] = -h[q, 0], -h[q, 1]
            by_point[k, q, 0], by_point[k, q, 1] = -H[q, 0], -H[q, 1]
        H[0, _OFFSET] = 1.0
        H[0, _SCALE] = r * shape
        H[0, _DEPTH] = -scale * r * lost
        H[0, _AXIS] = -turn
        H[1, _TURNED] = H[1, _WANDER] = 1.0
        H[1, _TURN_SCALE] = phi
    return z, by_robot, by_point
