"""The mount of a camera, from places on the floor and their pixels.

First the floor homography, on which points must agree (`camera_homography.py`); it gives a pose
(Zhang 2000, appendix) from which the residuals in the picture, lens and all, are minimised. Six
numbers instead of the eight of a homography: the lens determines what the points leave open, so
errors beyond the points are several times smaller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares  # type: ignore[import-untyped]

from robotctl.estimation.camera.calibration.homography import (
    GATE,
    PointNoise,
    find_homography,
    whitening,
)
from robotctl.model.sensors.camera import CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry, mount_of_pose
from robotctl.model.sensors.camera_lens import camera_matrix, straightened

KEYS = ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg")
FOCAL = "f_px"
_STEPS = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-2])
_BEHIND_PX = 1e4
"""Residual of a point behind the camera [px], which has no picture."""
_LEAST_HEIGHT_M = 1e-3
"""Minimum height of the camera in the search [m]."""
_FOCAL_SIGMA = 0.2
"""Relative standard deviation of the focal length from which on it is not determined."""


@dataclass(frozen=True, slots=True, eq=False)
class MountFit:
    """A calibrated mount.

    Parameters
    ----------
    intrinsics, mount
        The lens, as given or with the focal length found, and the mount found.
    keys
        Result: `KEYS`, and `FOCAL` where the lens was not known.
    P
        Covariance of these, (k, k), in their units; larger where the residuals were larger than
        the noise said.
    agree
        Which points it was made of, (n,); the others contradict them.
    residuals_px
        Measured less predicted pixels of all points, (n, 2) [px].
    chi2, degrees
        The sum of squared residuals of those that agree, in standard deviations, and its degrees
        of freedom.
    """

    intrinsics: CameraIntrinsics
    mount: CameraMount
    keys: tuple[str, ...]
    P: NDArray[np.float64]
    agree: NDArray[np.bool_]
    residuals_px: NDArray[np.float64]
    chi2: float
    degrees: int

    @property
    def camera(self) -> CameraGeometry:
        """The camera so calibrated."""
        return CameraGeometry(self.intrinsics, self.mount)

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each of `keys`."""
        return dict(zip(self.keys, np.sqrt(np.diag(self.P)).tolist(), strict=True))

    def jacobians(
        self, ground: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how pixels move with `keys`, (n, 2, k), and with the points, (n, 2, 2)."""
        values = _values(self.mount, self.intrinsics)[: len(self.keys)]
        by_keys = _by_values(self.intrinsics, values, ground)
        return by_keys, _by_ground(self.camera, ground)


def fit_mount(
    lens: CameraIntrinsics,
    ground: NDArray[np.float64],
    pixels: NDArray[np.float64],
    rng: np.random.Generator,
    noise: PointNoise,
    *,
    lens_known: bool = True,
) -> MountFit:
    """Find position and orientation of a camera.

    Parameters
    ----------
    lens
        Its lens; of one that is not known only the size of the picture counts.
    ground
        Places (x, y) in `base`, (n, 2), n >= 4, not on a line [m].
    pixels
        Where the camera sees them (u, v), (n, 2) [px].
    rng
        Chooses samples in the search for wrong points.
    noise
        How well places and pixels are known.
    lens_known
        If not: the focal length is found too; pixels are taken to be square, the principal point
        to be in the middle of the picture, and the lens to bend nothing.

    Raises
    ------
    ValueError
        If the points do not determine it, or contradict each other; says why.
    """
    lens, straight = (lens, straightened(pixels, lens)) if lens_known else (_plain(lens), pixels)
    if not np.isfinite(straight).all():
        raise ValueError("some pixels lie outside the lens's field of view: is it the right lens?")
    homography, agree = find_homography(ground, straight, rng, noise)
    if np.linalg.det(homography.H) > 0.0:
        raise ValueError(
            "the floor is seen as if from below, left and right swapped: is y to the left, x "
            "ahead, u to the right and v down?"
        )
    if not lens_known:
        focal_px = focal_length(homography.H, lens)
        lens = replace(lens, fx_px=focal_px, fy_px=focal_px)
    start = _values(_mount_of(homography.H, lens), lens)[: 6 if lens_known else 7]
    values, P, chi2 = _refined(lens, start, ground[agree], pixels[agree], noise)
    # Six numbers bend less towards wrong points than eight, and away from right ones.
    again = _agreeing(_camera_of(lens, values), ground, pixels, noise)
    if again.sum() >= agree.sum() and not np.array_equal(again, agree):
        agree = again
        values, P, chi2 = _refined(lens, values, ground[agree], pixels[agree], noise)
    camera = _camera_of(lens, values)
    keys = KEYS if lens_known else (*KEYS, FOCAL)
    degrees = 2 * int(agree.sum()) - len(keys)
    if degrees > 0:
        P = P * max(1.0, chi2 / degrees)
    if not lens_known:
        _check_focal(values[6], math.sqrt(P[6, 6]))
    residuals = pixels - camera.project_ground(ground)
    return MountFit(camera.intrinsics, camera.mount, keys, P, agree, residuals, chi2, degrees)


def _plain(lens: CameraIntrinsics) -> CameraIntrinsics:
    """Return a lens of focal length 1 that bends nothing, of the same picture."""
    middle = ((lens.width_px - 1) / 2.0, (lens.height_px - 1) / 2.0)
    return CameraIntrinsics(lens.width_px, lens.height_px, 1.0, 1.0, *middle)


def _check_focal(focal_px: float, sigma_px: float) -> None:
    """Raise ValueError if the points do not determine the focal length."""
    if not sigma_px < _FOCAL_SIGMA * focal_px:
        raise ValueError(
            f"these points do not determine the focal length ({focal_px:.0f} px, standard "
            f"deviation {sigma_px:.0f}): calibrate the lens, or spread the points"
        )


def focal_length(H: NDArray[np.float64], lens: CameraIntrinsics) -> float:
    """Return the focal length [px] that a floor homography, (3, 3), implies.

    For square pixels and the principal point of `lens`: the columns K^-1 h1 and K^-1 h2 are at
    right angles and of one length (Zhang 2000, equations 3 and 4).

    Raises
    ------
    ValueError
        If there is none, as for a camera that looks straight down.
    """
    centred = H[:2] - np.outer([lens.cx_px, lens.cy_px], H[2])
    (a1, a2), (c1, c2) = centred[:, :2].T, H[2, :2]
    known = np.array([a1 @ a2, a1 @ a1 - a2 @ a2])
    factor = np.array([c1 * c2, c1 * c1 - c2 * c2])
    weight = factor @ factor
    squared = -(known @ factor) / weight if weight > 0.0 else math.nan
    if not 0.0 < squared < 1e9:
        raise ValueError(
            "these points do not determine the focal length: calibrate the lens; a camera that "
            "looks straight down never shows it"
        )
    return math.sqrt(squared)


def _mount_of(H: NDArray[np.float64], lens: CameraIntrinsics) -> CameraMount:
    """Return the mount whose K R T is nearest to a homography of norm 1."""
    M = np.linalg.solve(camera_matrix(lens), H)
    scale = 0.5 * (np.linalg.norm(M[:, 0]) + np.linalg.norm(M[:, 1]))
    first, second, third = (M / scale).T
    U, _, Vt = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    R_camera_base = U @ Vt
    t_base_camera = -R_camera_base.T @ third
    t_base_camera[2] = max(t_base_camera[2], _LEAST_HEIGHT_M)
    return mount_of_pose(R_camera_base.T, t_base_camera)


def _refined(
    lens: CameraIntrinsics,
    start: NDArray[np.float64],
    ground: NDArray[np.float64],
    pixels: NDArray[np.float64],
    noise: PointNoise,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the values of least squares, their covariance, and chi2."""
    W = _whitening(_camera_of(lens, start), ground, noise)

    def residuals(values: NDArray[np.float64]) -> NDArray[np.float64]:
        off = np.nan_to_num(_projected(lens, values, ground) - pixels, nan=_BEHIND_PX)
        whitened: NDArray[np.float64] = np.einsum("nij,nj->ni", W, off).ravel()
        return whitened

    def slopes(values: NDArray[np.float64]) -> NDArray[np.float64]:
        J = np.nan_to_num(_by_values(lens, values, ground))
        whitened: NDArray[np.float64] = (W @ J).reshape(-1, len(values))
        return whitened

    found = least_squares(residuals, start, slopes, method="lm", x_scale="jac", xtol=1e-12)
    # Where the search went past straight down, the angles are brought back, and so are the slopes.
    camera = _camera_of(lens, found.x)
    final = _values(camera.mount, camera.intrinsics)[: len(start)]
    J = slopes(final)
    try:
        P = np.linalg.inv(J.T @ J).astype(np.float64)
    except np.linalg.LinAlgError:
        raise ValueError("these points do not determine the mount: spread them") from None
    return final, P, 2.0 * float(found.cost)


def _whitening(
    camera: CameraGeometry, ground: NDArray[np.float64], noise: PointNoise
) -> NDArray[np.float64]:
    """Return W with W^T W the inverse covariance of a pixel's residual, (n, 2, 2)."""
    return whitening(np.nan_to_num(_by_ground(camera, ground)), noise)


def _agreeing(
    camera: CameraGeometry,
    ground: NDArray[np.float64],
    pixels: NDArray[np.float64],
    noise: PointNoise,
) -> NDArray[np.bool_]:
    """Return which points lie within the gate of a camera, (n,)."""
    off = np.einsum(
        "nij,nj->ni", _whitening(camera, ground, noise), camera.project_ground(ground) - pixels
    )
    agree: NDArray[np.bool_] = np.nan_to_num(np.sum(off * off, axis=1), nan=np.inf) < GATE
    return agree


def _values(mount: CameraMount, lens: CameraIntrinsics) -> NDArray[np.float64]:
    """Return `KEYS` and `FOCAL`, (7,)."""
    return np.array([*(getattr(mount, key) for key in KEYS), lens.fx_px])


def _camera_of(lens: CameraIntrinsics, values: NDArray[np.float64]) -> CameraGeometry:
    """Return the camera of six or seven values; angles beyond their range are brought back."""
    x_m, y_m, z_m, yaw, pitch, roll = (float(value) for value in values[:6])
    if len(values) > 6:
        lens = replace(lens, fx_px=abs(float(values[6])), fy_px=abs(float(values[6])))
    z_m = max(z_m, _LEAST_HEIGHT_M)
    if -90.0 <= pitch <= 90.0:
        return CameraGeometry(lens, CameraMount(x_m, y_m, z_m, yaw, pitch, roll))
    turned = math.remainder(180.0 - pitch, 360.0)
    return CameraGeometry(
        lens, CameraMount(x_m, y_m, z_m, yaw + 180.0, max(-90.0, min(90.0, turned)), roll + 180.0)
    )


def _projected(
    lens: CameraIntrinsics, values: NDArray[np.float64], ground: NDArray[np.float64]
) -> NDArray[np.float64]:
    return _camera_of(lens, values).project_ground(ground)


def _by_values(
    lens: CameraIntrinsics, values: NDArray[np.float64], ground: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the numerical Jacobian of pixels by the values, (n, 2, k)."""
    J = np.empty((len(ground), 2, len(values)))
    for k, step in enumerate(_STEPS[: len(values)]):
        change = np.zeros(len(values))
        change[k] = step
        above, below = (_projected(lens, values + sign * change, ground) for sign in (1.0, -1.0))
        J[:, :, k] = (above - below) / (2.0 * step)
    return J


def _by_ground(camera: CameraGeometry, ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Jacobian of pixels by floor points, (n, 2, 2); nan behind the camera."""
    _, by_pixel = camera.ground_jacobian(camera.project_ground(ground))
    J = np.full((len(ground), 2, 2), np.nan)
    known = np.isfinite(by_pixel).all(axis=(1, 2))
    J[known] = np.linalg.inv(by_pixel[known])
    return J
