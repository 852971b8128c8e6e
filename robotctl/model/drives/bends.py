"""Many motions at once of drives with one steered axle.

Without numpy at import, since the control process loads the drives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def bent(
    rolled_m: NDArray[np.float64], angles_rad: NDArray[np.float64], wheelbase_m: float
) -> NDArray[np.float64]:
    """Return moves (n, 3), as of a `Twist`, for distances rolled by the rear wheels [m]."""
    import numpy as np  # noqa: PLC0415 - see above

    turned = rolled_m * np.tan(angles_rad) / wheelbase_m
    return np.stack([rolled_m, turned, np.zeros_like(rolled_m)], axis=1)


def pivoted(
    rolled_m: NDArray[np.float64], angles_rad: NDArray[np.float64], wheelbase_m: float
) -> NDArray[np.float64]:
    """Return moves (n, 3), as of a `Twist`, for distances rolled by the steered wheel [m]."""
    import numpy as np  # noqa: PLC0415 - see above

    turned = rolled_m * np.sin(angles_rad) / wheelbase_m
    return np.stack([rolled_m * np.cos(angles_rad), turned, np.zeros_like(rolled_m)], axis=1)


def steered_rows(
    moves: NDArray[np.float64], wheelbase_m: float, offset_rad: float, *, front: bool
) -> NDArray[np.float64]:
    """Return the driven wheel's distance [m] and the servo angle [rad] for moves, (n, 2).

    `front`: the steered wheel is the driven one. Without motion the servo stands at 0.
    """
    import numpy as np  # noqa: PLC0415 - see above

    d, across = moves[:, 0], wheelbase_m * moves[:, 1]
    # backwards, wheel and turn change their signs, and the steering stands as it did
    steering = np.arctan2(across * np.sign(d), np.abs(d))
    rolled = d / np.cos(steering) if front else d
    return np.stack([rolled, np.where(d == 0.0, 0.0, steering - offset_rad)], axis=1)
