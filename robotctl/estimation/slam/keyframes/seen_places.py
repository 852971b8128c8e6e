"""Loops by a camera: each keyframe has an image, recognised among those before it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.places.visual.recognition import (
    LEAST_FEATURES,
    VisualPlaces,
    VisualRecognition,
    sight_of,
)
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.estimation.slam.keyframes.loops import Candidate
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.model.geometry.se2 import SE2

IMAGE_NS: Final = 300_000_000
"""An image shows what a keyframe saw, if it was taken within this time of it [ns]."""
_SHIFT_M: Final = 1.5
_TURN_RAD: Final = 0.5
"""How far from the place of an image that fits another the robot may be."""


class SeenPlaces:
    """Tells a mapper's search of loops which images look like the place of an older one.

    An image that is recognised as none before it is kept on the map, and known again by those who
    go on with that.

    Attributes
    ----------
    keyframes
        Whose images are known, in their order; those that the map had are the first.
    recognitions
        What each of the others was recognised as; candidates are numbers of images in `keyframes`.

    Parameters
    ----------
    vocabulary
        Its words.
    mapper
        Of the keyframes; its scans bear out what the camera says.
    """

    def __init__(self, vocabulary: Vocabulary, mapper: SlamMapper) -> None:
        self._places = VisualPlaces(vocabulary)
        self._mapper = mapper
        self._looked_at = len(mapper.keyframes)
        self._last_ns: int | None = None
        self.keyframes = list(mapper.images)
        for each in mapper.images.values():
            self._places.add(sight_of(vocabulary, each))
        self.recognitions: list[VisualRecognition] = []

    def due(self, stamps_ns: Sequence[int]) -> list[tuple[int, int]]:
        """Return keyframes that are new since the last call, each with the image of its time.

        Parameters
        ----------
        stamps_ns
            Of the images that there are [ns].

        Returns
        -------
        list
            Number of the keyframe, and of its image in `stamps_ns`. An image has one keyframe; a
            keyframe without an image of its time is left out.
        """
        found = []
        keyframes, stamps = self._mapper.keyframes, np.array(stamps_ns, np.int64)
        for number in range(self._looked_at, len(keyframes)) if len(stamps) else ():
            off_ns = np.abs(stamps - keyframes[number].stamp_ns)
            nearest = int(np.argmin(off_ns))
            if off_ns[nearest] <= IMAGE_NS and stamps_ns[nearest] != self._last_ns:
                self._last_ns = stamps_ns[nearest]
                found.append((number, nearest))
        self._looked_at = len(keyframes)
        return found

    def see(self, number: int, features: Features) -> None:
        """Take the image of a keyframe."""
        sight = sight_of(self._places.vocabulary, features)
        recognition = self._places.recognise(sight, is_next=True)
        self._places.add(sight)
        self.keyframes.append(number)
        self.recognitions.append(recognition)
        found = recognition.found
        if found is not None:
            old = self.keyframes[found.image]
            self._mapper.loops.suggest(Candidate(number, old, "image", _SHIFT_M, _TURN_RAD, SE2()))
        elif len(features) >= LEAST_FEATURES:
            self._mapper.images[number] = Features(sight.points, sight.descriptors, sight.aspect)
