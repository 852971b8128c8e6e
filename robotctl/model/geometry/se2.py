"""SE(2): poses and rigid motions of the plane, in plain floats.

The tangent is (rho_x, rho_y, theta): translation first [m], then rotation [rad], in the frame on
the right (`T @ exp(xi)`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec

from robotctl.model.geometry.angles import sinc, wrap_angle


class Tangent2(NamedTuple):
    """Element of se(2): translation `rho_x_m`, `rho_y_m` [m] and rotation `theta_rad` [rad]."""

    rho_x_m: float
    rho_y_m: float
    theta_rad: float


class SE2(msgspec.Struct, frozen=True, gc=False):
    """Pose of frame b in frame a, or the motion `T_a_b` that maps b-coordinates to a.

    A struct, made in a tenth of the time of a frozen dataclass: each tick makes some.

    Parameters
    ----------
    x_m, y_m
        Origin of b in a [m].
    theta_rad
        Heading of b in a [rad]; kept as given here, wrapped to (-pi, pi] by every operation.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    theta_rad: float = 0.0

    @staticmethod
    def exp(rho_x_m: float, rho_y_m: float, theta_rad: float) -> SE2:
        """Return the motion reached by the constant body velocity (rho, theta) in unit time."""
        half = 0.5 * theta_rad
        a = sinc(theta_rad)
        b = math.sin(half) * sinc(half)  # (1 - cos theta) / theta, without cancellation
        return SE2(a * rho_x_m - b * rho_y_m, b * rho_x_m + a * rho_y_m, wrap_angle(theta_rad))

    def log(self) -> Tangent2:
        """Return the tangent with rotation in (-pi, pi] whose `exp` is this motion."""
        theta = wrap_angle(self.theta_rad)
        half = 0.5 * theta
        h = math.cos(half) / sinc(half)  # theta/2 cot(theta/2)
        return Tangent2(h * self.x_m + half * self.y_m, h * self.y_m - half * self.x_m, theta)

    def __matmul__(self, other: SE2) -> SE2:
        """Return `T_a_c = T_a_b @ T_b_c`."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return SE2(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrap_angle(self.theta_rad + other.theta_rad),
        )

    def inverse(self) -> SE2:
        """Return `T_b_a`."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return SE2(
            -c * self.x_m - s * self.y_m, s * self.x_m - c * self.y_m, wrap_angle(-self.theta_rad)
        )

    def apply(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Map the point (x, y) of frame b to frame a [m]."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return self.x_m + c * x_m - s * y_m, self.y_m + s * x_m + c * y_m
