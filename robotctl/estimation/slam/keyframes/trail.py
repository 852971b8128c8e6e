"""The keyframes that were passed last: what a scan is matched and linked with."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.keyframes.back_end import BackEnd, certain
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.keyframes.local_map import LocalMap, local_map
from robotctl.estimation.slam_config import KeyframeConfig


class Trail:
    """Numbers of keyframes, the one that was passed last at the end.

    Parameters
    ----------
    config, keyframes, back_end
        The map.
    """

    def __init__(
        self, config: KeyframeConfig, keyframes: list[Keyframe], back_end: BackEnd
    ) -> None:
        self._config = config
        self._keyframes = keyframes
        self._back_end = back_end
        self._numbers: list[int] = []
        self._local: LocalMap | None = None

    def last(self, count: int) -> list[int]:
        """Return the last ones, at most so many."""
        return self._numbers[-count:]

    @property
    def local(self) -> LocalMap:
        """The map of the last ones, in the frame of the newest."""
        if self._local is None:
            chosen = self.last(self._config.local_keyframes)
            self._local = local_map(
                [self._keyframes[each] for each in chosen],
                [self._back_end.between(chosen[-1], each) for each in chosen],
            )
        return self._local

    def redraw(self) -> None:
        """Draw the map again: keyframes moved, or have other scans."""
        self._local = None

    def add(self, number: int) -> None:
        """Pass a keyframe."""
        if self._numbers[-1:] != [number]:
            self._local = None
        before = max(self._config.local_keyframes, self._config.linked_keyframes) - 1
        self._numbers = [*[each for each in self._numbers if each != number][-before:], number]

    def begin(self, number: int | None = None) -> None:
        """Be at a keyframe, as if those around it had been passed; None: at an unknown place."""
        self._numbers, self._local = [], None
        if number is None:
            return
        poses, sure = self._back_end.poses, certain(self._back_end.doubts(number))
        away = np.hypot(*(poses[:, :2] - poses[number, :2]).T)
        nearest = np.argsort(np.where(sure, away, np.inf))[: self._config.local_keyframes]
        self._numbers = [int(each) for each in nearest[::-1] if sure[each]]
