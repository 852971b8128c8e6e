"""Storage in which parameters outlive a power cut."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from robotctl.config_values import Value


class ParameterStore(Protocol):
    """Keeps the values that differ from those of the robot's file."""

    def save(self, values: Mapping[str, Value]) -> bool:
        """Keep exactly these, by dotted key; return whether a power cut would not lose them."""


class NoParameterStore:
    """Keeps nothing."""

    def save(self, values: Mapping[str, Value]) -> bool:  # noqa: ARG002
        """Save nothing."""
        return False
