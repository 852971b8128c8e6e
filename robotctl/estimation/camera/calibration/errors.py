"""Errors of a calibrated camera at known places: radial and lateral.

Errors are split along the direction from the camera (radial, positive: estimated too far) and
across it (lateral, positive: too far left), because a wrong pitch or height shows in the first and
a wrong yaw in the second.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi_square  # type: ignore[import-untyped]

from robotctl.estimation.camera.calibration.homography import PointNoise
from robotctl.model.sensors.camera_geometry import CameraGeometry

BANDS_M = (0.0, 1.0, 2.0, 3.0, math.inf)
SURE = 0.999
"""Probability with which noise alone explains the errors of a good calibration."""


@dataclass(frozen=True, slots=True, eq=False)
class FloorErrors:
    """Errors of places on the floor.

    Parameters
    ----------
    told
        Where the camera says the points are, (n, 2) in `base` [m]; nan: not on the floor.
    range_m
        Their true distance from the point of the floor below the camera, (n,) [m].
    off_m
        Radial and lateral error, (n, 2) [m].
    P
        Covariance expected of these from the noise of pixels and places, (n, 2, 2) [m^2].
    """

    told: NDArray[np.float64]
    range_m: NDArray[np.float64]
    off_m: NDArray[np.float64]
    P: NDArray[np.float64]

    @property
    def chi2(self) -> NDArray[np.float64]:
        """Squared errors in standard deviations, (n,), two degrees of freedom each; nan stays."""
        result: NDArray[np.float64] = np.full(len(self.off_m), np.nan)
        known = np.isfinite(self.off_m).all(axis=1)
        off, P = self.off_m[known], self.P[known]
        result[known] = np.einsum("ni,ni->n", off, np.linalg.solve(P, off[:, :, None])[:, :, 0])
        return result


@dataclass(frozen=True, slots=True)
class Band:
    """Errors at one range of distances.

    Parameters
    ----------
    low_m, high_m
        Which distances [m].
    count
        How many points.
    bias_m
        Mean radial and lateral error [m].
    rmse_m
        Root mean square of the distance between estimated and true [m].
    expected_m
        The same as expected from the noise [m].
    chi2
        Sum over the points; `2 count` is expected.
    """

    low_m: float
    high_m: float
    count: int
    bias_m: tuple[float, float]
    rmse_m: float
    expected_m: float
    chi2: float

    @property
    def surprising(self) -> bool:
        """Whether noise alone gives such errors in less than 1 of 1000 cases."""
        return self.chi2 > float(chi_square.ppf(SURE, 2 * self.count))


def floor_errors(
    camera: CameraGeometry,
    ground: NDArray[np.float64],
    pixels: NDArray[np.float64],
    noise: PointNoise,
) -> FloorErrors:
    """Return the errors of a camera at known places.

    Parameters
    ----------
    camera
        As calibrated.
    ground
        Where the points are (x, y), (n, 2) in `base` [m].
    pixels
        Where they are seen (u, v), (n, 2) [px].
    noise
        How well both are known.
    """
    told, P = camera.ground_covariance(pixels, noise.sigma_px)
    P = P + noise.sigma_m**2 * np.eye(2)
    away = ground - camera.t_base_camera[:2]
    range_m = np.linalg.norm(away, axis=1)
    c, s = (away / np.maximum(range_m, 1e-9)[:, None]).T
    R = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
    off = np.einsum("nij,nj->ni", R, told - ground)
    return FloorErrors(told, range_m.astype(np.float64), off, R @ P @ np.swapaxes(R, 1, 2))


def bands(errors: FloorErrors) -> tuple[Band, ...]:
    """Return the errors by distance, for each band with points that are on the floor."""
    found = []
    chi2 = errors.chi2
    known = np.isfinite(errors.off_m).all(axis=1)
    for low_m, high_m in itertools.pairwise(BANDS_M):
        chosen = known & (errors.range_m >= low_m) & (errors.range_m < high_m)
        if chosen.any():
            off = errors.off_m[chosen]
            variance = np.trace(errors.P[chosen], axis1=1, axis2=2)
            radial_m, lateral_m = (float(value) for value in off.mean(axis=0))
            found.append(
                Band(
                    low_m,
                    high_m,
                    int(chosen.sum()),
                    (radial_m, lateral_m),
                    math.sqrt(float(np.mean(np.sum(off * off, axis=1)))),
                    math.sqrt(float(np.mean(variance))),
                    float(chi2[chosen].sum()),
                )
            )
    return tuple(found)
