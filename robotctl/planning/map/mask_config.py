"""Masks of a robot's file: pictures of where it keeps out, or drives slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import PurePath
from typing import Literal, TypeAlias

from robotctl.errors import InvalidValue

MaskKind: TypeAlias = Literal["keep_out", "speed_percent", "speed_m_s", "binary"]


@dataclass(frozen=True, slots=True)
class MaskConfig:
    """A mask as for nav2's costmap filters: a ROS map whose values mean something else.

    Parameters
    ----------
    file
        Its yaml file; a relative path starts beside the robot's file.
    kind
        Where the value is 100, the robot keeps out (`keep_out`), and a value v from 1 to 99 makes
        each metre of a path count as 1 + v / 25; or a value from 1 to 100 limits its speed to `base
        + multiplier * value`, in per cent of its fastest or in m/s; or that marks an area where it
        exceeds 0.5 (`binary`), and the robot reports when it enters or leaves that.
    base, multiplier
        As nav2's `costmap_filter_info_server` has them.

    Raises
    ------
    InvalidValue
        If a number is not finite.
    """

    file: str
    kind: MaskKind
    base: float = 0.0
    multiplier: float = 1.0

    @property
    def name(self) -> str:
        """Name of the area of a binary mask: that of the file, without its suffix."""
        return PurePath(self.file).stem

    def __post_init__(self) -> None:
        for name in ("base", "multiplier"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise InvalidValue(name, f"{value} found, a finite number allowed", value)
