"""Where a robot is to drive to."""

from __future__ import annotations

from typing import NamedTuple


class Goal(NamedTuple):
    """A place of `world` to drive to [m], and the heading there [rad]; None: any."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
