"""The tables `[[motor]]`: the keys common to all kinds of drives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, NamedTuple

from pydantic import Field, TypeAdapter

from firmware_sim.config.quantities import Positive, closed

OWN_KIND: Final = "native"
"""Kind of our own controller."""
CHANNELS: Final = 2
"""Maximum motors that it drives."""


@closed
@dataclass(frozen=True, slots=True)
class AxisSection:
    """One axis of a drive and the wheel or joint on it."""

    actuator: str
    axis: Annotated[int, Field(strict=True, ge=1, le=8)] = 1
    reversed: bool = False
    ratio: Positive = 1.0

    @property
    def motor_per_wheel(self) -> float:
        """Motor turns per wheel turn, negative for a reversed motor."""
        return -self.ratio if self.reversed else self.ratio


class MotorTable(NamedTuple):
    """One drive: kind, name, bus, and all keys of its table unchanged."""

    kind: str
    name: str
    bus: str
    axes: tuple[AxisSection, ...]
    keys: Mapping[str, Any]


_AXES: Final = TypeAdapter(tuple[AxisSection, ...])


def motor_table(keys: Mapping[str, Any]) -> MotorTable:
    """Return a table; only the keys common to all kinds are checked.

    Raises
    ------
    ValueError
        If it has no kind, name or axes.
    """
    for key in ("kind", "name"):
        if not isinstance(keys.get(key), str):
            raise ValueError(f"{key}: must be a text, found {keys.get(key)!r}")
    axes = _AXES.validate_python(keys.get("axes", ()))
    return MotorTable(keys["kind"], keys["name"], str(keys.get("bus", "")), axes, keys)
