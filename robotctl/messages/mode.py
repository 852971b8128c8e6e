"""Modes of the navigator."""

from __future__ import annotations

import enum


class Mode(enum.IntEnum):
    """Modes of the navigator, with ArduRover's mode numbers."""

    MANUAL = 0
    """Drive by the sticks of the operator."""
    HOLD = 4
    """Stand still."""
    AUTO = 10
    """Drive the mission."""
    RTL = 11
    """Return home along the travelled path."""
    GUIDED = 15
    """Drive by velocities or positions from a ground station."""
