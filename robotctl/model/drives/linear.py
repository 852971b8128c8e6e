"""Many motions at once of drives without joints, whose motion is linear in the wheel speeds.

Without numpy at import, since the control process loads the drives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from robotctl.model.drives.wheels import ActuatorReference
from robotctl.model.geometry.twist import Twist

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class LinearDrive(Protocol):
    """A drive without joints."""

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels."""

    def inverse(self, twist: Twist) -> ActuatorReference:
        """Return the wheel speeds for a body velocity."""

    def forward(self, wheels_rad_s: tuple[float, ...]) -> Twist:
        """Return the velocity of `base` for wheel speeds."""


def forward_many(drive: LinearDrive, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `forward` of turns of the wheels (n, wheels) [rad]: (n, 3) as of a `Twist`."""
    import numpy as np  # noqa: PLC0415 - see above

    units = np.eye(len(drive.wheel_names)).tolist()
    moved: NDArray[np.float64] = rows @ np.array([drive.forward(tuple(unit)) for unit in units])
    return moved


def inverse_many(drive: LinearDrive, moves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `inverse` of moves (n, 3), as of a `Twist`: turns of the wheels (n, wheels) [rad]."""
    import numpy as np  # noqa: PLC0415 - see above

    units = (Twist(*unit) for unit in np.eye(3).tolist())
    rows: NDArray[np.float64] = moves @ np.array([drive.inverse(u).wheels_rad_s for u in units])
    return rows
