"""Keyframes passed last, which a scan is matched and linked with."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.keyframes.back_end import certain
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.local_map import LocalMap, map_of


class Trail:
    """Numbers of keyframes in the order of passing, the last one at the end.

    Parameters
    ----------
    growing
        The map.
    """

    def __init__(self, growing: GrowingMap) -> None:
        self._growing = growing
        self._config, _, self._back_end = growing
        self._numbers: list[int] = []
        self._local: LocalMap | None = None

    def last(self, count: int) -> list[int]:
        """Return the last ones, at most `count`."""
        return self._numbers[-count:]

    @property
    def local(self) -> LocalMap:
        """The map of the last ones, in the frame of the newest."""
        if self._local is None:
            chosen = self.last(self._config.local_keyframes)
            self._local = map_of(self._growing.surface(chosen, chosen[-1]))
        return self._local

    def redraw(self) -> None:
        """Rebuild the map: keyframes moved, or have other scans."""
        self._local = None

    def add(self, number: int) -> None:
        """Pass a keyframe."""
        if self._numbers[-1:] != [number]:
            self._local = None
        before = max(self._config.local_keyframes, self._config.linked_keyframes) - 1
        self._numbers = [*[each for each in self._numbers if each != number][-before:], number]

    def begin(self, number: int | None = None) -> None:
        """Start at a keyframe, as if those around it had been passed; None: at an unknown place."""
        self._numbers, self._local = [], None
        if number is None:
            return
        poses, sure = self._back_end.poses, certain(self._back_end.doubts(number))
        away = np.hypot(*(poses[:, :2] - poses[number, :2]).T)
        nearest = np.argsort(np.where(sure, away, np.inf))[: self._config.local_keyframes]
        self._numbers = [int(each) for each in nearest[::-1] if sure[each]]
