"""The exceptions of the firmware simulator."""

from __future__ import annotations


class SimulationError(Exception):
    """A robot or world file is invalid, or simulation is impossible; one line for each error."""
