"""The modes."""

from __future__ import annotations

import enum


class Mode(enum.IntEnum):
    """Modes of the navigator, with ArduRover's mode numbers."""

    MANUAL = 0
    """The sticks of the operator."""
    HOLD = 4
    """Stand still."""
    AUTO = 10
    """The mission."""
    RTL = 11
    """Return home along the path it came."""
    GUIDED = 15
    """Velocities or positions from a ground station."""
