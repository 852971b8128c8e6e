"""How well a signature determines the robot's position and heading.

A recognised place has the position of the visit that it is like. A robot that stands off by delta
hears an echo v . delta nearer (`_nearer`), so D grows by delta^T J delta / 2, with J the mean of
v v^T / (2 sigma^2) over the bearings with an echo; as much of delta as would explain all of D is
P = D J^-1. Silent bearings say nothing of it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.places import ANY_HEADING
from robotctl.estimation.places.signatures import Signature, SignatureConfig
from robotctl.model.geometry.angles import wrap_angle

_STEEPEST: Final = 1.5
"""If the depth grows faster with the bearing than this, in depths per radian, another surface
begins."""


def rotation(
    curve: NDArray[np.float64], shift: int, difference: float, independent: float
) -> tuple[float, float]:
    """Return the turn at a minimum of D over shifts [rad], and its variance [rad^2].

    By the parabola through three shifts; the variance is that of least squares, 2 D / (n D''), with
    n independent bearings.
    """
    n = len(curve)
    step = math.tau / n
    before, here, after = curve[shift - 1], curve[shift], curve[(shift + 1) % n]
    bend = float(before - 2.0 * here + after)
    if not 0.0 < bend < math.inf:
        return wrap_angle(shift * step), ANY_HEADING
    offset = 0.5 * float(before - after) / bend
    variance = 2.0 * difference * step**2 / (independent * bend)
    return wrap_angle((shift + offset) * step), min(variance, ANY_HEADING)


def position_covariance(
    known: Signature, heading_rad: float, difference: float, config: SignatureConfig
) -> NDArray[np.float64]:
    """Return the covariance of the robot's position relative to a visit, (2, 2) [m^2].

    Parameters
    ----------
    known
        Signature of the visit.
    heading_rad
        Heading of `base` at the visit, in the frame of the covariance [rad].
    difference
        D that is to be explained, > 0.
    config
        Settings of the signatures; nothing beyond the maximum range is known.
    """
    echo = np.nan_to_num(1.0 - known.silence)
    nearer = echo * _nearer(known.depth_m, heading_rad)
    seen = np.count_nonzero(known.seen)
    sharpness = nearer @ nearer.T / (2.0 * config.depth_sigma_m**2 * seen)
    anywhere = np.eye(2) / config.max_range_m**2
    return np.asarray(np.linalg.inv(sharpness / difference + anywhere), dtype=np.float64)


def _nearer(depth_m: NDArray[np.float64], heading_rad: float) -> NDArray[np.float64]:
    """Return how much nearer the echo at each bearing comes per step in x and in y, (2, n).

    That is n / (n . u) for a surface of normal n at bearing u, or u - (r' / r) t with t across u
    and r' the slope of the depth over the bearing, by the neighbours of the same surface; where
    there is none, u.
    """
    step = math.tau / len(depth_m)
    u = heading_rad + (np.arange(len(depth_m)) + 0.5) * step
    rises = np.stack([np.roll(depth_m, -1) - depth_m, depth_m - np.roll(depth_m, 1)])
    slopes = rises / (step * depth_m)
    same = np.abs(slopes) < _STEEPEST  # not where one is nan
    slope = np.where(same, slopes, 0.0).sum(axis=0) / np.maximum(same.sum(axis=0), 1)
    return np.stack([np.cos(u) + slope * np.sin(u), np.sin(u) - slope * np.cos(u)])
