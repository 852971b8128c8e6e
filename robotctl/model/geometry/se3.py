"""SE(3): poses and rigid motions of space, with their adjoint and Jacobians.

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

    @staticmethod
    def from_matrix(T: Matrix) -> SE3:
        """Return the motion of a homogeneous matrix (4, 4).

        Raises
        ------
        ValueError
            If the upper left block is no rotation or the last row is not (0, 0, 0, 1).
        """
        if T.shape != (4, 4) or not np.allclose(T[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError("T is not a homogeneous (4, 4) matrix")
        return SE3(_triple(T[:3, 3]), so3.quaternion_of(T[:3, :3]))

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

    def adjoint(self) -> Matrix:
        """Return Ad(T), (6, 6): T exp(xi) = exp(Ad(T) xi) T."""
        R = self.rotation()
        Ad = np.zeros((6, 6))
        Ad[:3, :3] = Ad[3:, 3:] = R
        Ad[:3, 3:] = so3.hat(np.array(self.translation_m)) @ R
        return Ad

    def inverse_jacobian(self) -> Matrix:
        """Return the Jacobian of `inverse` by this motion, (6, 6): -Ad(T)."""
        return -self.adjoint()

    def compose_jacobians(self, other: SE3) -> tuple[Matrix, Matrix]:
        """Return the Jacobians of `self @ other` by each, (6, 6): Ad(other)^-1 and I."""
        return other.inverse().adjoint(), np.eye(6)

    def apply_jacobians(self, point: Vector) -> tuple[Matrix, Matrix]:
        """Return the Jacobians of `apply(point)`: by this motion, (3, 6), by the point, (3, 3)."""
        R = self.rotation()
        return np.hstack([R, -R @ so3.hat(point)]), R


def left_jacobian(xi: Vector) -> Matrix:
    """Return J_l(xi), (6, 6): exp(xi + d) = exp(J_l(xi) d) exp(xi) to first order.

    Barfoot, "State Estimation for Robotics" (2017), (7.85) and (7.86).
    """
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = so3.left_jacobian(xi[3:])
    J[:3, 3:] = _Q(xi)
    return J


def left_jacobian_inverse(xi: Vector) -> Matrix:
    """Return the inverse of J_l(xi), (6, 6), for |phi| < 2 pi (Barfoot, 7.95)."""
    inverse = so3.left_jacobian_inverse(xi[3:])
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = inverse
    J[:3, 3:] = -inverse @ _Q(xi) @ inverse
    return J


def right_jacobian(xi: Vector) -> Matrix:
    """Return J_r(xi) = J_l(-xi), (6, 6): exp(xi + d) = exp(xi) exp(J_r(xi) d) to first order."""
    return left_jacobian(-xi)


def right_jacobian_inverse(xi: Vector) -> Matrix:
    """Return the inverse of J_r(xi), (6, 6), for |phi| < 2 pi: the Jacobian of `log`."""
    return left_jacobian_inverse(-xi)


def _Q(xi: Vector) -> Matrix:
    """Return the coupling of rotation into translation, (3, 3) (Barfoot, 7.86)."""
    k = so3.coefficients(float(np.linalg.norm(xi[3:])))
    X, P = so3.hat(xi[:3]), so3.hat(xi[3:])
    PX, XP = P @ X, X @ P
    PXP = PX @ P
    Q: Matrix = (
        0.5 * X
        + k.c * (PX + XP + PXP)
        + k.d * (P @ PX + XP @ P - 3.0 * PXP)
        + k.e * (PXP @ P + P @ PXP)
    )
    return Q


def _triple(vector: Vector) -> tuple[float, float, float]:
    """Return the three entries of `vector` as floats."""
    return float(vector[0]), float(vector[1]), float(vector[2])
