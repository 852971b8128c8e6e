"""Types of the numbers in the simulator's files, with their ranges.

No length, mass or resistance of a robot exceeds a million in the units of its key: greater numbers
are mistakes, and would overflow.
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import ConfigDict, Field, with_config

Real: TypeAlias = Annotated[float, Field(strict=True, ge=-1e6, le=1e6, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(strict=True, ge=1e-9, le=1e6, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(strict=True, ge=0, le=1e6, allow_inf_nan=False)]
Counts: TypeAlias = Annotated[int, Field(strict=True, gt=0, le=10_000_000)]
Rate: TypeAlias = Annotated[float, Field(strict=True, ge=0.1, le=240)]
Share: TypeAlias = Annotated[float, Field(strict=True, ge=0, le=1)]
RelativeError: TypeAlias = Annotated[float, Field(strict=True, gt=-0.5, lt=0.5)]
Point: TypeAlias = tuple[Real, Real]

closed = with_config(ConfigDict(extra="forbid"))
"""Decorator of a dataclass in whose table an unknown key is an error."""
