"""Common part of drives without joints, whose motion is linear in the wheel speeds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Protocol

from robotctl.model.drives.wheels import ActuatorReference
from robotctl.model.geometry.twist import Twist

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class _Linear(Protocol):
    @property
    def wheel_names(self) -> tuple[str, ...]: ...
    def inverse(self, twist: Twist) -> ActuatorReference: ...
    def forward(self, wheels_rad_s: tuple[float, ...]) -> Twist: ...


class LinearDrive:
    """A drive without joints, which turns on the spot."""

    __slots__ = ()

    calibrated: ClassVar[Mapping[str, tuple[float, float]]]
    """Keys that calibration of the odometry sets, with the minimum and maximum of each."""
    degrees_of_freedom: ClassVar[int] = 3
    """Degrees of freedom of the pose in the plane: x, y, theta."""
    holonomic: ClassVar[bool] = False
    """Whether it can be commanded to move sideways."""
    steered: ClassVar[bool] = False
    joint_names: ClassVar[tuple[str, ...]] = ()
    joint_max_rad: ClassVar[tuple[float, ...]] = ()
    joint_rate_max_rad_s: ClassVar[tuple[float, ...]] = ()
    min_turning_radius_m: ClassVar[float] = 0.0
    """Minimum radius of the path of `base` [m]: it turns on the spot."""

    def forward_many(self: _Linear, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `forward` of turns of the wheels (n, wheels) [rad]: (n, 3) as of a `Twist`."""
        import numpy as np  # noqa: PLC0415 - the control process loads the drives, not numpy

        units = np.eye(len(self.wheel_names)).tolist()
        moves: NDArray[np.float64] = rows @ np.array([self.forward(tuple(unit)) for unit in units])
        return moves

    def inverse_many(self: _Linear, moves: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `inverse` of moves (n, 3), as of a `Twist`: turns of the wheels, (n, wheels)."""
        import numpy as np  # noqa: PLC0415 - the control process loads the drives, not numpy

        units = (Twist(*unit) for unit in np.eye(3).tolist())
        rows: NDArray[np.float64] = moves @ np.array([self.inverse(u).wheels_rad_s for u in units])
        return rows
