"""The graph of SLAM as a message, at most once a second."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.messages.estimation import SlamGraph
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2

_PERIOD_NS: Final = 1_000_000_000
"""Shortest interval between two messages [ns]."""
_AGAIN_NS: Final = 10_000_000_000
"""Interval at which late subscribers are told what has not changed [ns]."""


class SlamGraphs:
    """Makes the messages: links are only ever added, so those of before stay as they are."""

    def __init__(self) -> None:
        self._count = 0
        """Links that are in `_links` and `_loops`."""
        self._links, self._loops = bytearray(), bytearray()
        self._shown = np.empty((0, 3))
        self._shown_ns = -_AGAIN_NS

    def due(self, back_end: BackEnd, T_world_map: SE2, now_ns: int) -> SlamGraph | None:
        """Return the graph if it has changed or was told long ago; None: not now."""
        age_ns = now_ns - self._shown_ns
        if age_ns < _PERIOD_NS:
            return None
        poses, links = back_end.poses, back_end.links
        is_same = self._count == len(links) and np.array_equal(poses, self._shown)
        if len(poses) == 0 or (is_same and age_ns < _AGAIN_NS):
            return None
        new = links[self._count :]
        self._links += _pairs([(each.first, each.second) for each in new if not each.is_loop])
        self._loops += _pairs([(each.first, each.second) for each in new if each.is_loop])
        self._count = len(links)
        self._shown, self._shown_ns = poses.copy(), now_ns
        placed = np.column_stack(
            [moved(T_world_map, poses[:, :2]), poses[:, 2] + T_world_map.theta_rad]
        )
        packed = placed.astype(np.dtype("<f4")).tobytes()
        return SlamGraph(now_ns, packed, bytes(self._links), bytes(self._loops))


def _pairs(numbers: list[tuple[int, int]]) -> bytes:
    return np.array(numbers, np.dtype("<i4")).tobytes()
