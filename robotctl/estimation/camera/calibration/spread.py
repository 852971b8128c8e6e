"""Expected error of a calibration away from its markers, and which markers would help.

To first order: the covariance of the calibration, carried to the floor. A sheet near the robot says
little of the floor at 3 m, where a tenth of a degree of pitch is 5 cm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration.homography import PointNoise, floor_covariance
from robotctl.estimation.camera.calibration.mount import MountFit
from robotctl.model.sensors.camera_geometry import CameraGeometry

RANGES_M = (0.5, 1.0, 1.5, 2.0, 3.0)
ALLOWED = 0.01
"""Standard deviation of a place from the calibration alone, as a share of its distance."""
_STEP_M = 0.25
"""Spacing of the places that are proposed for markers [m]."""
_SIDE_M = 2.0
"""Greatest distance of such a place to the side [m]."""
_MARGIN_PX = 15.0
"""Minimum distance of such a place from the picture's edge [px]."""
_MOST_MARKERS = 6
"""Maximum number of proposed markers."""


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected error of a calibration at one distance.

    Parameters
    ----------
    range_m
        Distance from the point of the floor below the camera [m].
    calibration_m
        Root mean square of the error of places there, over the picture's width [m].
    pixel_m
        The same from one standard deviation of a pixel, which is new in each picture [m].
    """

    range_m: float
    calibration_m: float
    pixel_m: float

    @property
    def enough(self) -> bool:
        """Whether the calibration errs less than `ALLOWED`."""
        return self.calibration_m <= ALLOWED * self.range_m


@dataclass(frozen=True, slots=True)
class Advice:
    """The benefit of more markers.

    Parameters
    ----------
    markers
        Where to put them, (x, y) in `base` [m].
    expected
        The expected result.
    """

    markers: tuple[tuple[float, float], ...]
    expected: tuple[Expected, ...]


def expected_errors(fit: MountFit, sigma_px: float) -> tuple[Expected, ...]:
    """Return what a calibration is expected to err at `RANGES_M`, as far as the camera sees."""
    return _expected(_probes(fit), fit.P, sigma_px)


def recommend(fit: MountFit, noise: PointNoise) -> Advice | None:
    """Return where more markers help most, until all errors are within `ALLOWED`; None if they are.

    One after the other, each where it lowers the largest expected error, as a share of the
    distance, most; up to six, and none that helps by less than a tenth.

    Parameters
    ----------
    fit
        The calibration.
    noise
        How well the new markers will be known.
    """
    probes = _probes(fit)
    if not probes or _worst(probes, fit.P) <= ALLOWED:
        return None
    places = _candidates(fit.camera)
    by_keys, by_ground = fit.jacobians(places)
    C = noise.sigma_px**2 * np.eye(2) + noise.sigma_m**2 * by_ground @ np.swapaxes(by_ground, 1, 2)
    gains = np.swapaxes(by_keys, 1, 2) @ np.linalg.inv(C) @ by_keys
    P = fit.P
    chosen: list[tuple[float, float]] = []
    while len(places) and len(chosen) < _MOST_MARKERS and _worst(probes, P) > ALLOWED:
        information = np.linalg.inv(P)
        outcomes = [_worst(probes, np.linalg.inv(information + gain)) for gain in gains]
        best = int(np.argmin(outcomes))
        if outcomes[best] > 0.9 * _worst(probes, P):
            break
        P = np.linalg.inv(information + gains[best])
        chosen.append((round(float(places[best, 0]), 3), round(float(places[best, 1]), 3)))
    return Advice(tuple(chosen), _expected(probes, P, noise.sigma_px))


class _Probe(NamedTuple):
    """Points of the floor at one distance, by the Jacobians of their pixels."""

    range_m: float
    by_keys: NDArray[np.float64]
    by_ground: NDArray[np.float64]


def _probes(fit: MountFit) -> list[_Probe]:
    """Return probes at those distances at which the camera sees the floor."""
    camera = fit.camera
    foot = camera.t_base_camera[:2]
    probes = []
    for range_m in RANGES_M:
        bearings = np.linspace(-math.pi, math.pi, 181)[1:]
        points = foot + range_m * np.column_stack([np.cos(bearings), np.sin(bearings)])
        seen = camera.inside(camera.project_ground(points))
        if seen.any():
            probes.append(_Probe(range_m, *fit.jacobians(points[seen])))
    return probes


def _expected(
    probes: Sequence[_Probe], P: NDArray[np.float64], sigma_px: float
) -> tuple[Expected, ...]:
    """Return the expected errors at the probes for the covariance `P` of the calibration."""
    return tuple(
        Expected(probe.range_m, _rms(probe, P, 0.0), _rms(probe, np.zeros_like(P), sigma_px))
        for probe in probes
    )


def _worst(probes: Sequence[_Probe], P: NDArray[np.float64]) -> float:
    """Return the largest error by a covariance of the calibration as a share of the distance."""
    return max(_rms(probe, P, 0.0) / probe.range_m for probe in probes)


def _rms(probe: _Probe, P: NDArray[np.float64], sigma_px: float) -> float:
    """Return the root mean square of the expected error of places [m]."""
    covariance = floor_covariance(probe.by_keys, probe.by_ground, P, sigma_px)
    return math.sqrt(float(np.nanmean(np.trace(covariance, axis1=1, axis2=2))))


def _candidates(camera: CameraGeometry) -> NDArray[np.float64]:
    """Return places for markers on a grid in `base` that are well in the picture, (n, 2) [m]."""
    far_m = camera.mount.x_m + RANGES_M[-1]
    x_m, y_m = np.meshgrid(
        np.arange(math.ceil((far_m - 2 * RANGES_M[-1]) / _STEP_M), far_m / _STEP_M) * _STEP_M,
        np.arange(-_SIDE_M, _SIDE_M + 1e-9, _STEP_M),
    )
    places = np.column_stack([x_m.ravel(), y_m.ravel()])
    near = np.linalg.norm(places - camera.t_base_camera[:2], axis=1) <= RANGES_M[-1]
    pixels = camera.project_ground(places)
    size = np.array([camera.intrinsics.width_px, camera.intrinsics.height_px])
    with np.errstate(invalid="ignore"):
        well = np.all((pixels >= _MARGIN_PX) & (pixels <= size - 1.0 - _MARGIN_PX), axis=1)
    chosen: NDArray[np.float64] = places[near & well]
    return chosen
