"""SE(3): poses and rigid motions of space.

The tangent is xi = (rho, phi), (6,): translation first [m], then rotation vector [rad]. The
rotation is kept as a unit quaternion: `log` then is good near pi too, and long chains of
compositions do not drift away from SO(3). Perturbations stand on the right: T becomes
`T @ exp(delta)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robotctl.model.geometry import so3
from robotctl.model.geometry.so3 import Matrix, Quaternion, Vector


@dataclass(frozen=True, slots=True)
class SE3:
    """Pose of frame b in frame a, or the motion `T_a_b` that maps b-coordinates to a.

    Parameters
    ----------
    translation_m
        Origin of b in a (x, y, z) [m].
    quaternion
        Rotation (w, x, y, z); scaled to length 1 with w >= 0.

    Raises
    ------
    ValueError
        If the quaternion is all zero or not finite.
    """

    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "quaternion", so3.canonical(self.quaternion))

    @staticmethod
    def exp(xi: Vector) -> SE3:
        """Return the motion reached by the constant body velocity `xi` (6,) in unit time."""
        rho, phi = xi[:3], xi[3:]
        return SE3(_triple(so3.left_jacobian(phi) @ rho), so3.quaternion_exp(phi))

    def log(self) -> Vector:
        """Return the tangent (6,) with |phi| in [0, pi] whose `exp` is this motion."""
        phi = so3.quaternion_log(self.quaternion)
        rho = so3.left_jacobian_inverse(phi) @ self.translation_m
        return np.concatenate([rho, phi])

    def rotation(self) -> Matrix:
        """Return the rotation matrix, (3, 3)."""
        return so3.rotation_matrix(self.quaternion)

    def matrix(self) -> Matrix:
        """Return the homogeneous matrix, (4, 4)."""
        T = np.eye(4)
        T[:3, :3] = self.rotation()
        T[:3, 3] = self.translation_m
        return T

    def __matmul__(self, other: SE3) -> SE3:
        """Return `T_a_c = T_a_b @ T_b_c`."""
        return SE3(
            _triple(self.apply(np.array(other.translation_m))),
            so3.quaternion_product(self.quaternion, other.quaternion),
        )

    def inverse(self) -> SE3:
        """Return `T_b_a`."""
        w, x, y, z = self.quaternion
        translation = -self.rotation().T @ np.array(self.translation_m)
        return SE3(_triple(translation), (w, -x, -y, -z))

    def apply(self, points: Vector) -> Vector:
        """Map points of frame b, (3,) or (n, 3), to frame a [m]."""
        mapped: Vector = points @ self.rotation().T + np.array(self.translation_m)
        return mapped


def _triple(vector: Vector) -> tuple[float, float, float]:
    """Return the three entries of `vector` as floats."""
    return float(vector[0]), float(vector[1]), float(vector[2])
