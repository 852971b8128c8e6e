"""Status of a pose estimate; without numpy, for the control process."""

from __future__ import annotations

import enum


class LocalisationStatus(enum.IntEnum):
    """Reliability of a pose estimate."""

    SEARCHING = 0
    """The belief is spread or has several clusters: the pose is a guess."""
    LOCALISED = 1
    """One compact belief that agrees with the measurements."""
    LOST = 2
    """The belief contradicts the measurements."""
