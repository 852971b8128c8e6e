"""Four mecanum wheels, whose rollers let the robot move in any direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from robotctl.model.drives.linear import LinearDrive
from robotctl.model.drives.wheels import POSITIVE, ActuatorReference, require_positive
from robotctl.model.geometry.twist import Twist


@dataclass(frozen=True, slots=True)
class MecanumDrive(LinearDrive):
    """Four driven wheels with rollers at 45 degrees; moves sideways and turns on the spot.

    Seen from above, the axes of the uppermost rollers form an X; those of the rollers on the floor,
    along which a wheel pushes, form a diamond around `base`, the middle of the four contacts. So
    the front left and rear right wheels push forwards and to the right, the other two forwards and
    to the left. Source: P. F. Muir and C. P. Neuman, "Kinematic modeling for feedback control of an
    omnidirectional wheeled mobile robot", ICRA 1987.

    Parameters
    ----------
    kind
        Always "mecanum".
    track_width_m
        Distance of the left and right contact points [m], > 0.
    wheelbase_m
        Distance of the front and the rear axle [m], > 0.
    wheel_radius_m
        Radius of the wheels over the rollers [m], > 0.
    counts_per_revolution
        Quadrature counts per turn of a wheel, > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["mecanum"]
    track_width_m: float
    wheelbase_m: float
    wheel_radius_m: float
    counts_per_revolution: int

    calibrated: ClassVar[Mapping[str, tuple[float, float]]] = {
        "wheel_radius_m": POSITIVE,
        "track_width_m": POSITIVE,
    }
    """The track width stands for the lever, of which it is a part."""
    holonomic: ClassVar[bool] = True
    wheel_names: ClassVar[tuple[str, ...]] = (
        "front_left",
        "front_right",
        "rear_left",
        "rear_right",
    )

    def __post_init__(self) -> None:
        require_positive(
            self, "track_width_m", "wheelbase_m", "wheel_radius_m", "counts_per_revolution"
        )

    @property
    def wheel_radii_m(self) -> tuple[float, ...]:
        """Radius of each wheel [m]."""
        return (self.wheel_radius_m,) * 4

    @property
    def lever_m(self) -> float:
        """Speed of a wheel's rim for a turning rate of 1 rad/s [m]: half track plus half base."""
        return 0.5 * (self.track_width_m + self.wheelbase_m)

    def inverse(
        self,
        twist: Twist,
        joints_meas_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> ActuatorReference:
        """Return the wheel speeds for a body velocity; `joints_meas_rad` is not used."""
        v, turn, vy = twist.v_m_s, self.lever_m * twist.omega_rad_s, twist.vy_m_s
        r = self.wheel_radius_m
        return ActuatorReference(
            ((v - vy - turn) / r, (v + vy + turn) / r, (v + vy - turn) / r, (v - vy + turn) / r), ()
        )

    def forward(
        self,
        wheels_rad_s: tuple[float, ...],
        joints_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> Twist:
        """Return the velocity of `base` that fits four wheel speeds best (least squares)."""
        front_left, front_right, rear_left, rear_right = wheels_rad_s
        quarter_m = 0.25 * self.wheel_radius_m
        return Twist(
            quarter_m * (front_left + front_right + rear_left + rear_right),
            quarter_m * (front_right + rear_right - front_left - rear_left) / self.lever_m,
            quarter_m * (front_right + rear_left - front_left - rear_right),
        )
