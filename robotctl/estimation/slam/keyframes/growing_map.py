"""The map as it grows, which all stages of SLAM share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from robotctl.estimation.slam.front_end.surface import Surface, joined
from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe


class GrowingMap(NamedTuple):
    """Settings, the scans that are kept, and their poses with the links between them."""

    config: KeyframeConfig
    keyframes: list[Keyframe]
    back_end: BackEnd

    def surface(self, numbers: Iterable[int], centre: int) -> Surface:
        """Return the echoes of some keyframes in the frame of one."""
        between = self.back_end.between
        return joined(
            [self.keyframes[each].surface.moved(between(centre, each)) for each in numbers]
        )
