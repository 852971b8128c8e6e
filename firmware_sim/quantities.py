"""Types of the numbers in the simulator's files, with what is allowed."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import ConfigDict, Field, with_config

Real: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Share: TypeAlias = Annotated[float, Field(strict=True, ge=0, le=1)]
RelativeError: TypeAlias = Annotated[float, Field(strict=True, gt=-0.5, lt=0.5)]
Point: TypeAlias = tuple[Real, Real]

closed = with_config(ConfigDict(extra="forbid"))
"""Decorator of a dataclass in whose table an unknown key is an error."""
