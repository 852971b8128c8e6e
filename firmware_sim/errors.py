"""The exceptions of the firmware simulator."""

from __future__ import annotations


class SimulationError(Exception):
    """A robot or world file is wrong, or nothing can be simulated; one line for each error."""
