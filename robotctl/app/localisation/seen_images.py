"""Images of keyframes, by which a robot that maps recognises where it has been before."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from robotctl.estimation.places.visual.features import Features, features_in
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.seen_places import SeenPlaces
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary
from robotctl.messages.estimation import CameraView, ImageFeatures

_KEPT: Final = 64
"""Number of images that wait for a keyframe of their time: one of a long stretch is 30 s old."""
_REHEARSED: Final = 60
"""Features of an image, enough for it to be recognised."""


class SeenImages:
    """Finds the image of each keyframe.

    Parameters
    ----------
    mapper
        Mapper that the images are shown to.
    """

    def __init__(self, mapper: SlamMapper) -> None:
        self._places = SeenPlaces(load_vocabulary(shipped_vocabulary()), mapper)
        self._waiting: deque[tuple[int, ImageFeatures]] = deque(maxlen=_KEPT)

    def add(self, views: Sequence[CameraView]) -> None:
        """Keep images until a keyframe of their time comes."""
        for each in views:
            if each.features is not None:
                self._waiting.append((each.stamp_ns, each.features))

    def show_new(self) -> None:
        """Show the mapper the image of each new keyframe that has one."""
        stamps_ns = [stamp_ns for stamp_ns, _ in self._waiting]
        for number, row in self._places.due(stamps_ns):
            self._places.see(number, features_in(self._waiting[row][1]))


def rehearse(mapper: SlamMapper) -> None:
    """Warm up: compile, or load from the cache, all that recognising a place needs."""
    rng = np.random.default_rng(0)
    looks = [
        Features(
            rng.random((_REHEARSED, 2)),
            rng.integers(0, 2**63, (_REHEARSED, 4), dtype=np.uint64),
            0.75,
        )
        for _ in range(40)
    ]
    seen = SeenPlaces(load_vocabulary(shipped_vocabulary()), mapper)
    for each in (*looks, looks[0]):
        seen.see(0, each)
