"""Parts of the tables `[[motor]]` that all kinds of drives share, as the simulator reads them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from firmware_sim.config.quantities import closed


@closed
@dataclass(frozen=True, slots=True)
class AxisSection:
    """One axis of a drive, and what it turns; `ratio`: turns of the motor for one of the wheel."""

    actuator: str
    axis: Annotated[int, Field(strict=True, ge=1, le=8)] = 1
    reversed: bool = False
    ratio: Annotated[float, Field(strict=True, ge=1e-3, le=1e3)] = 1.0
