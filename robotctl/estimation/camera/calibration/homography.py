"""The floor homography, from points of the floor to pixels, computed from known places alone.

(u, v, 1) ~ H (x, y, 1). The plain linear least squares with H's last entry set to 1 fail where that
entry is 0, with the horizon through the origin. Here H has norm
1, points are normalised first, and then the residuals in the picture are minimised (Hartley and
Zisserman, Multiple View Geometry, 2nd ed., 4.1, 4.4, algorithms 4.1 and 4.2). A homography knows no
lens: give it straightened pixels (`camera_lens.straightened`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration import homography_kernels as kernels

GATE = 16.0
"""Four standard deviations, squared: anything beyond is an outlier, 3 in 10000 by chance."""
_SAMPLES = 2000
_UNCERTAIN = 0.3
_ON_A_LINE = 1e-6
_LEAST_REDUNDANT = 5


@dataclass(frozen=True, slots=True)
class PointNoise:
    """Uncertainty of correspondences.

    Parameters
    ----------
    sigma_px
        Standard deviation of u and of v, > 0 [px].
    sigma_m
        Standard deviation of x and of y on the floor, independent from point to point, >= 0 [m].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    sigma_px: float = 0.5
    sigma_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.sigma_px < np.inf:
            raise ValueError(f"sigma_px must be > 0, not {self.sigma_px}")
        if not 0.0 <= self.sigma_m < np.inf:
            raise ValueError(f"sigma_m must be >= 0, not {self.sigma_m}")


@dataclass(frozen=True, slots=True, eq=False)
class Homography:
    """A homography of the floor with its covariance.

    Parameters
    ----------
    H
        (3, 3), of norm 1 and with the sign that makes the third coordinate of seen points > 0.
    P
        Covariance of the entries of H, row by row, (9, 9), of rank 8: along H itself it is 0.
    residuals_px
        Measured less predicted pixels of the points it was made of, (n, 2) [px].
    chi2
        Their sum of squares in standard deviations; 2 n - 8 is expected of it.
    """

    H: NDArray[np.float64]
    P: NDArray[np.float64]
    residuals_px: NDArray[np.float64]
    chi2: float

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `chi2`: 2 n - 8."""
        return 2 * len(self.residuals_px) - 8

    def pixels(self, ground: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pixels of points (x, y) of the floor, (n, 2); nan behind the camera."""
        return _mapped(self.H, ground)

    def ground(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the floor of pixels (u, v), (n, 2) [m]; nan above the horizon."""
        return _mapped(np.linalg.inv(self.H).astype(np.float64, copy=False), pixels)

    def jacobians(
        self, ground: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how pixels move with H, (n, 2, 9), and with the points (n, 2), (n, 2, 2)."""
        points = np.column_stack([ground, np.ones(len(ground))])
        mapped = points @ self.H.T
        scaled, pixels = points / mapped[:, 2:], mapped[:, :2] / mapped[:, 2:]
        by_H = np.zeros((len(ground), 2, 9))
        by_H[:, 0, 0:3] = by_H[:, 1, 3:6] = scaled
        by_H[:, :, 6:9] = -pixels[:, :, None] * scaled[:, None, :]
        by_ground = self.H[:2, :2] - pixels[:, :, None] * self.H[2, :2]
        return by_H, by_ground / mapped[:, 2, None, None]

    def ground_covariance(
        self, pixels: NDArray[np.float64], sigma_px: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points of the floor and their covariance, from H's and the pixel's noise.

        Parameters
        ----------
        pixels
            (u, v), (n, 2) [px].
        sigma_px
            Standard deviation of u and of v [px].

        Returns
        -------
        tuple
            (x, y), (n, 2) [m], and covariances, (n, 2, 2) [m^2]; nan above the horizon.
        """
        ground = self.ground(pixels)
        return ground, floor_covariance(*self.jacobians(ground), self.P, sigma_px)


def floor_covariance(
    by_parameters: NDArray[np.float64],
    by_ground: NDArray[np.float64],
    P: NDArray[np.float64],
    sigma_px: float,
) -> NDArray[np.float64]:
    """Return the covariance of floor points computed from their pixels.

    A pixel is a function of the parameters and of the point; solved for the point, to first order.

    Parameters
    ----------
    by_parameters, by_ground
        Jacobians of the pixels, (n, 2, k) and (n, 2, 2).
    P
        Covariance of the parameters, (k, k).
    sigma_px
        Standard deviation of u and of v [px].

    Returns
    -------
    ndarray
        (n, 2, 2) [m^2]; nan if the Jacobian is.
    """
    inverse = np.full_like(by_ground, np.nan)
    known = np.isfinite(by_ground).all(axis=(1, 2))
    inverse[known] = np.linalg.inv(by_ground[known])
    of_pixels = by_parameters @ P @ np.swapaxes(by_parameters, 1, 2) + sigma_px**2 * np.eye(2)
    covariance: NDArray[np.float64] = inverse @ of_pixels @ np.swapaxes(inverse, 1, 2)
    return covariance


def fit_homography(
    ground: NDArray[np.float64], pixels: NDArray[np.float64], noise: PointNoise = PointNoise()
) -> Homography:
    """Return the least-squares homography; all points count, so none may be wrong.

    Parameters
    ----------
    ground
        Places (x, y) on the floor, (n, 2), n >= 4 [m].
    pixels
        Where they are seen (u, v), (n, 2) [px].
    noise
        How well both are known.

    Raises
    ------
    ValueError
        If the arrays do not fit, or the points do not determine a homography; says why.
    """
    ground, pixels = _checked(ground, pixels)
    near, s, x, y = kernels.normalised(ground)
    seen, t, u, v = kernels.normalised(pixels)
    reason = _degenerate(near, seen, t, noise.sigma_px)
    if reason:
        raise ValueError(reason)
    _, vectors = np.linalg.eigh(kernels.linear_equations(near, seen))
    h, P, chi2 = kernels.refine(
        vectors[:, 0].copy(), near, seen, t * noise.sigma_px, s * noise.sigma_m
    )
    if not np.trace(P) < _UNCERTAIN**2:
        raise ValueError(
            f"the points are too near to a line, or too near to each other, for pixels known to "
            f"{noise.sigma_px:g} px: spread them over the floor in both directions"
        )
    sides = near @ h[6:8] + h[8]
    if not (np.all(sides > 0.0) or np.all(sides < 0.0)):
        raise ValueError(
            "no camera can see these points like this, some would lie behind it: are points "
            "swapped, or u with v, or x with y?"
        )
    h, P = kernels.unnormalised(h * np.sign(sides[0]), P, (s, x, y), (t, u, v))
    H = h.reshape(3, 3)
    return Homography(H, P, pixels - _mapped(H, ground), float(chi2))


def find_homography(
    ground: NDArray[np.float64],
    pixels: NDArray[np.float64],
    rng: np.random.Generator,
    noise: PointNoise = PointNoise(),
) -> tuple[Homography, NDArray[np.bool_]]:
    """Return the homography on which most points agree, and these points.

    Parameters
    ----------
    ground, pixels, noise
        As for `fit_homography`. With four points no outlier can be identified.
    rng
        Chooses the samples (RANSAC).

    Returns
    -------
    tuple
        The homography of the points that agree, and whether a point is one of them, (n,).

    Raises
    ------
    ValueError
        As `fit_homography`, and if fewer than five points or half of them agree: then others
        could as well be right.
    """
    ground, pixels = _checked(ground, pixels)
    n = len(ground)
    if n == 4:
        return fit_homography(ground, pixels, noise), np.ones(4, dtype=np.bool_)
    near, s, *_ = kernels.normalised(ground)
    seen, t, *_ = kernels.normalised(pixels)
    reason = _degenerate(near, seen, t, noise.sigma_px)
    if reason:
        raise ValueError(reason)
    samples = rng.integers(n, size=(_SAMPLES, 4))
    h = kernels.consensus(near, seen, samples, t * noise.sigma_px, s * noise.sigma_m, GATE)
    agree, _ = kernels.agreeing(h, near, seen, t * noise.sigma_px, s * noise.sigma_m, GATE)
    for _ in range(10):
        if agree.sum() < max(_LEAST_REDUNDANT, n / 2):
            raise ValueError(
                f"only {agree.sum()} of {n} points agree with each other within "
                f"{noise.sigma_px:g} px and {1e3 * noise.sigma_m:g} mm: they contradict each "
                "other, or are less accurate than that"
            )
        found = fit_homography(ground[agree], pixels[agree], noise)
        now, _ = kernels.agreeing(
            found.H.ravel(), ground, pixels, noise.sigma_px, noise.sigma_m, GATE
        )
        if np.array_equal(now, agree):
            break
        agree = now
    return found, agree


def _mapped(H: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return H (p, 1) divided by its third coordinate, (n, 2); nan if that is not > 0."""
    mapped = points @ H[:, :2].T + H[:, 2]
    ahead = np.where(mapped[:, 2] > 0.0, mapped[:, 2], np.nan)
    result: NDArray[np.float64] = mapped[:, :2] / ahead[:, None]
    return result


def _checked(
    ground: NDArray[np.float64], pixels: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return both as (n, 2) contiguous floats; raises ValueError if they are not that."""
    ground = np.ascontiguousarray(ground, dtype=float)
    pixels = np.ascontiguousarray(pixels, dtype=float)
    if ground.ndim != 2 or ground.shape[1] != 2 or ground.shape != pixels.shape:
        raise ValueError(
            f"ground {ground.shape} and pixels {pixels.shape} must both be (n, 2), one row a point"
        )
    if len(ground) < 4:
        raise ValueError(f"{len(ground)} points; a homography needs 4, and more to check it")
    if not (np.isfinite(ground).all() and np.isfinite(pixels).all()):
        raise ValueError("ground and pixels must be finite")
    return ground, pixels


def _degenerate(
    ground: NDArray[np.float64], pixels: NDArray[np.float64], scale: float, sigma_px: float
) -> str:
    """Return why normalised points determine no homography, or an empty text."""
    for points, what, tolerance in (
        (ground, "on the floor", _ON_A_LINE),
        (pixels, f"in the picture (to {sigma_px:g} px)", max(_ON_A_LINE, scale * sigma_px)),
    ):
        of_all, least, different = kernels.least_deviation(points)
        if different < 4:
            return f"only {different} different points {what}; a homography needs 4"
        if of_all < tolerance:
            return f"all points {what} lie on a line: spread them in both directions"
        if least < tolerance:
            return f"all points {what} but one lie on a line: two or more must lie beside it"
    return ""
