"""The lens: from the plane z = 1 of the camera's frame to pixels and back.

The model and its signs are those of `CameraIntrinsics`. It is inverted by Newton's method with its
own Jacobian. Where the polynomial of the radius stops growing (the edge of a wide lens, beyond the
range of the fit), it has no inverse: nan.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from robotctl.model.sensors.camera import CameraIntrinsics

_NEWTON_STEPS = 20
_CONVERGED = 1e-12


def camera_matrix(intrinsics: CameraIntrinsics) -> NDArray[np.float64]:
    """Return K, (3, 3) [px]: pixels of a lens without distortion are K (x, y, 1)."""
    return np.array(
        [
            [intrinsics.fx_px, 0.0, intrinsics.cx_px],
            [0.0, intrinsics.fy_px, intrinsics.cy_px],
            [0.0, 0.0, 1.0],
        ]
    )


def distort(
    plane: NDArray[np.float64], distortion: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Apply the lens to points of the plane z = 1.

    Parameters
    ----------
    plane
        Points (x, y), (n, 2).
    distortion
        (k1, k2, p1, p2, k3).

    Returns
    -------
    tuple
        Distorted points, (n, 2), and the Jacobians, (n, 2, 2).
    """
    k1, k2, p1, p2, k3 = distortion
    x, y = plane[:, 0], plane[:, 1]
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))
    seen = np.empty_like(plane)
    seen[:, 0] = x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x)
    seen[:, 1] = y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y
    J = np.empty((len(plane), 2, 2))
    J[:, 0, 0] = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    J[:, 1, 1] = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    J[:, 0, 1] = J[:, 1, 0] = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return seen, J


def undistort(
    seen: NDArray[np.float64], distortion: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Undo `distort`.

    Parameters
    ----------
    seen
        Distorted points, (n, 2).
    distortion
        (k1, k2, p1, p2, k3).

    Returns
    -------
    tuple
        Points of the plane z = 1, (n, 2), nan if there is none, and the Jacobians of this
        inverse, (n, 2, 2).
    """
    if not any(distortion):
        return seen.copy(), np.broadcast_to(np.eye(2), (len(seen), 2, 2)).copy()
    plane = seen.copy()
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            shown, J = distort(plane, distortion)
            step = np.einsum("nij,nj->ni", _inverse(J), seen - shown)
            plane += step
            if not np.any(np.abs(step) > _CONVERGED):
                break
        shown, J = distort(plane, distortion)
        wrong = ~(np.abs(shown - seen).max(axis=1, initial=0.0) < 1e-9)
        wrong |= ~within_lens(plane, distortion)
        inverse = _inverse(J)
    plane[wrong] = np.nan
    inverse[wrong] = np.nan
    return plane, inverse


def straightened(pixels: NDArray[np.float64], intrinsics: CameraIntrinsics) -> NDArray[np.float64]:
    """Return the pixels, (n, 2) [px], without the lens's distortion; nan: none."""
    focal = np.array([intrinsics.fx_px, intrinsics.fy_px])
    centre = np.array([intrinsics.cx_px, intrinsics.cy_px])
    plane, _ = undistort((pixels - centre) / focal, intrinsics.distortion)
    straight: NDArray[np.float64] = plane * focal + centre
    return straight


def within_lens(plane: NDArray[np.float64], distortion: tuple[float, ...]) -> NDArray[np.bool_]:
    """Return for points of the plane z = 1, (n, 2), whether the lens has an inverse there, (n,).

    It has one up to the radius where r (1 + k1 r^2 + k2 r^4 + k3 r^6) stops growing.
    """
    k1, k2, _, _, k3 = distortion
    inside: NDArray[np.bool_] = np.sum(plane * plane, axis=1) < _turning_point(k1, k2, k3)
    return inside


@lru_cache(maxsize=16)
def _turning_point(k1: float, k2: float, k3: float) -> float:
    """Return the smallest r^2 > 0 with 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6 = 0, else inf."""
    # In 1/r^2 the polynomial is monic, so coefficients that are 0 do no harm.
    roots = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
    real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 1e-12)]
    return 1.0 / float(real.max()) if real.size else np.inf


def _inverse(J: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverses of matrices (n, 2, 2); inf or nan if there is none."""
    a, b, c, d = J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1]
    adjugate = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2)
    inverse: NDArray[np.float64] = adjugate / (a * d - b * c)[:, None, None]
    return inverse
