"""The floor homography, from points of the floor to pixels, computed from known places alone.

(u, v, 1) ~ H (x, y, 1). OpenCV finds H and the points that agree; here it gets norm 1, the least
residuals in the picture for points of unequal accuracy, and its covariance (Hartley and Zisserman,
Multiple View Geometry, 2nd ed., 4.4 and 5.2). Points are normalised first, without which the last
entry of H, which OpenCV sets to 1, is 0 with the horizon through the origin. A homography knows no
lens: give it straightened pixels (`camera_lens.straightened`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

GATE: Final = 16.0
"""Four standard deviations, squared: anything beyond is an outlier, 3 in 10000 by chance."""
_SAMPLES: Final = 2000
_CONFIDENCE: Final = 0.9999
"""Maximum number of samples of RANSAC, and the probability of one without outliers at which it
ends."""
_STEPS: Final = 30
_SMALL_STEP: Final = 1e-12
"""Maximum number of Gauss-Newton steps, and the length of one that ends them: rounding."""
_UNCERTAIN: Final = 0.3
"""Standard deviation of the scaled homography from which on the points do not determine it."""
_ON_A_LINE: Final = 1e-6
"""Distance from a line within which normalised points lie on it: rounding."""
_LEAST_REDUNDANT: Final = 5
"""Minimum number of points that agree where others are left out: four fit any homography."""


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

    H: Array
    P: Array
    residuals_px: Array
    chi2: float

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `chi2`: 2 n - 8."""
        return 2 * len(self.residuals_px) - 8

    def pixels(self, ground: Array) -> Array:
        """Return the pixels of points (x, y) of the floor, (n, 2); nan behind the camera."""
        return _mapped(self.H, ground)

    def ground(self, pixels: Array) -> Array:
        """Return the points of the floor of pixels (u, v), (n, 2) [m]; nan above the horizon."""
        return _mapped(np.linalg.inv(self.H).astype(np.float64, copy=False), pixels)

    def jacobians(self, ground: Array) -> tuple[Array, Array]:
        """Return how pixels move with H, (n, 2, 9), and with the points (n, 2), (n, 2, 2)."""
        by_H, by_ground, _ = _derivatives(self.H, ground)
        return by_H, by_ground

    def ground_covariance(self, pixels: Array, sigma_px: float) -> tuple[Array, Array]:
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
    by_parameters: Array,
    by_ground: Array,
    P: Array,
    sigma_px: float,
) -> Array:
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
    covariance: Array = inverse @ of_pixels @ np.swapaxes(inverse, 1, 2)
    return covariance


def fit_homography(ground: Array, pixels: Array, noise: PointNoise = PointNoise()) -> Homography:
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
    near, A = _normalised(ground)
    seen, B = _normalised(pixels)
    reason = _degenerate(near, seen, B[0, 0], noise.sigma_px)
    if reason:
        raise ValueError(reason)
    H, P, chi2 = _refined(
        np.asarray(cv2.findHomography(near, seen)[0], dtype=np.float64),
        near,
        seen,
        PointNoise(B[0, 0] * noise.sigma_px, A[0, 0] * noise.sigma_m),
    )
    if not np.trace(P) < _UNCERTAIN**2:
        raise ValueError(
            f"the points are too near to a line, or too near to each other, for pixels known to "
            f"{noise.sigma_px:g} px: spread them over the floor in both directions"
        )
    sides = near @ H[2, :2] + H[2, 2]
    if not (np.all(sides > 0.0) or np.all(sides < 0.0)):
        raise ValueError(
            "no camera can see these points like this, some would lie behind it: are points "
            "swapped, or u with v, or x with y?"
        )
    # H = B^-1 H_n A; scaling it to norm 1 takes its own direction out of the covariance.
    undo = np.linalg.inv(B)
    H = np.sign(sides[0]) * undo @ H @ A
    norm = np.linalg.norm(H)
    H /= norm
    L = np.kron(undo, A.T)
    L = (L - np.outer(H, H.ravel() @ L)) / norm
    return Homography(H, L @ P @ L.T, pixels - _mapped(H, ground), chi2)


def find_homography(
    ground: Array,
    pixels: Array,
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
    near, A = _normalised(ground)
    seen, B = _normalised(pixels)
    reason = _degenerate(near, seen, B[0, 0], noise.sigma_px)
    if reason:
        raise ValueError(reason)
    agree = _consensus(
        near, seen, PointNoise(B[0, 0] * noise.sigma_px, A[0, 0] * noise.sigma_m), rng
    )
    for _ in range(10):
        if agree.sum() < max(_LEAST_REDUNDANT, n / 2):
            raise ValueError(
                f"only {agree.sum()} of {n} points agree with each other within "
                f"{noise.sigma_px:g} px and {1e3 * noise.sigma_m:g} mm: they contradict each "
                "other, or are less accurate than that"
            )
        found = fit_homography(ground[agree], pixels[agree], noise)
        now = _agreeing(found.H, ground, pixels, noise)
        if np.array_equal(now, agree):
            break
        agree = now
    return found, agree


def _consensus(
    ground: Array, pixels: Array, noise: PointNoise, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Return which points agree on one homography, (n,), as OpenCV finds it by samples of four."""
    order = rng.permutation(len(ground))
    H, _ = cv2.findHomography(
        ground[order],
        pixels[order],
        cv2.RANSAC,
        np.sqrt(GATE) * np.hypot(noise.sigma_px, noise.sigma_m),
        maxIters=_SAMPLES,
        confidence=_CONFIDENCE,
    )
    if H is None:
        return np.zeros(len(ground), dtype=np.bool_)
    return _agreeing(np.asarray(H, dtype=np.float64), ground, pixels, noise)


def _agreeing(H: Array, ground: Array, pixels: Array, noise: PointNoise) -> NDArray[np.bool_]:
    """Return which points are within `GATE`, on the side of the camera where most are, (n,)."""
    if 2 * np.sum(ground @ H[2, :2] + H[2, 2] > 0.0) < len(ground):
        H = -H
    _, by_ground, off = _derivatives(H, ground, pixels)
    distances = np.sum(np.square(whitening(by_ground, noise) @ off[:, :, None]), axis=(1, 2))
    near: NDArray[np.bool_] = (distances < GATE) & (ground @ H[2, :2] + H[2, 2] > 0.0)
    return near


def _refined(
    H: Array, ground: Array, pixels: Array, noise: PointNoise
) -> tuple[Array, Array, float]:
    """Minimise the residuals in the picture by the method of Gauss and Newton.

    Scaling H moves no pixel, so J h = 0; h h^T makes the equations solvable without taking part in
    the step, which stays orthogonal to h.

    Returns
    -------
    tuple
        H, (3, 3), of norm 1; its covariance, (9, 9), of rank 8; the sum of squared residuals in
        standard deviations.
    """
    h = H.ravel() / np.linalg.norm(H)
    for _ in range(_STEPS):
        by_H, by_ground, off = _derivatives(h.reshape(3, 3), ground, pixels)
        W = whitening(by_ground, noise)
        J, e = (W @ by_H).reshape(-1, 9), (W @ off[:, :, None]).ravel()
        inverse = np.linalg.inv(J.T @ J + np.outer(h, h))
        step = inverse @ (J.T @ e)
        if np.linalg.norm(step) < _SMALL_STEP:
            break
        h = (h + step) / np.linalg.norm(h + step)
    return h.reshape(3, 3), inverse - np.outer(h, h), float(e @ e)


def _derivatives(
    H: Array, ground: Array, pixels: Array | float = 0.0
) -> tuple[Array, Array, Array]:
    """Return Jacobians by H, (n, 2, 9), and by the points, (n, 2, 2), and the residuals, (n, 2)."""
    points = np.column_stack([ground, np.ones(len(ground))])
    mapped = points @ H.T
    scaled, predicted = points / mapped[:, 2:], mapped[:, :2] / mapped[:, 2:]
    by_H = np.zeros((len(ground), 2, 9))
    by_H[:, 0, 0:3] = by_H[:, 1, 3:6] = scaled
    by_H[:, :, 6:9] = -predicted[:, :, None] * scaled[:, None, :]
    by_ground = H[:2, :2] - predicted[:, :, None] * H[2, :2]
    return by_H, by_ground / mapped[:, 2, None, None], pixels - predicted


def whitening(by_ground: Array, noise: PointNoise) -> Array:
    """Return W, (n, 2, 2), with W^T W the inverse covariance of the residuals of pixels."""
    spread = noise.sigma_m**2 * by_ground @ np.swapaxes(by_ground, 1, 2)
    W: Array = np.linalg.inv(np.linalg.cholesky(spread + noise.sigma_px**2 * np.eye(2)))
    return W


def _normalised(points: Array) -> tuple[Array, Array]:
    """Return points with centroid 0 and mean distance sqrt(2) (Hartley 1997), and the map there."""
    centre = points.mean(axis=0)
    spread = np.linalg.norm(points - centre, axis=1).mean()
    scale = np.sqrt(2.0) / spread if spread > 0.0 else 1.0
    A = np.diag([scale, scale, 1.0])
    A[:2, 2] = -scale * centre
    return scale * (points - centre), A


def _mapped(H: Array, points: Array) -> Array:
    """Return H (p, 1) divided by its third coordinate, (n, 2); nan if that is not > 0."""
    mapped = points @ H[:, :2].T + H[:, 2]
    ahead = np.where(mapped[:, 2] > 0.0, mapped[:, 2], np.nan)
    result: Array = mapped[:, :2] / ahead[:, None]
    return result


def _checked(ground: Array, pixels: Array) -> tuple[Array, Array]:
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


def _degenerate(ground: Array, pixels: Array, scale: float, sigma_px: float) -> str:
    """Return why normalised points determine no homography, or an empty text."""
    for points, what, tolerance in (
        (ground, "on the floor", _ON_A_LINE),
        (pixels, f"in the picture (to {sigma_px:g} px)", max(_ON_A_LINE, scale * sigma_px)),
    ):
        different = np.unique(points, axis=0)
        if len(different) < 4:
            return f"only {len(different)} different points {what}; a homography needs 4"
        of_all = _off_line(different)
        least = min(_off_line(np.delete(different, k, axis=0)) for k in range(len(different)))
        if of_all < tolerance:
            return f"all points {what} lie on a line: spread them in both directions"
        if least < tolerance:
            return f"all points {what} but one lie on a line: two or more must lie beside it"
    return ""


def _off_line(points: Array) -> float:
    """Return how far points are from their best line, root mean square."""
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(singular[-1] / np.sqrt(len(points)))
