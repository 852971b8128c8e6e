"""Loops by a camera: each keyframe has an image, recognised among those before it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from robotctl.estimation.places.recogniser import Candidate, Recognition
from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.places.visual.recognition import (
    LEAST_FEATURES,
    VisualCandidate,
    VisualPlaces,
    sight_of,
)
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.estimation.slam.keyframes.mapper import SlamMapper

IMAGE_NS: Final = 300_000_000
"""Maximum time between a keyframe and the image that shows the same [ns]."""


class Seen(NamedTuple):
    """The image of a keyframe."""

    keyframe: int
    features: Features


class SeenPlaces:
    """Suggests loops to a mapper where an image looks like the place of an older one.

    An image of a new place is kept on the map, for drives that continue it.

    Attributes
    ----------
    keyframes
        Keyframes whose images are known, in their order; first those that the map had.
    recognitions
        What each of the others was recognised as; its places are numbers of images in `keyframes`.

    Parameters
    ----------
    vocabulary
        Its words.
    mapper
        Mapper of the keyframes; its scans verify what the camera suggests.
    """

    def __init__(self, vocabulary: Vocabulary, mapper: SlamMapper) -> None:
        self._places = VisualPlaces(vocabulary)
        self._mapper = mapper
        self._looked_at = len(mapper.keyframes)
        self._last_ns: int | None = None
        self.keyframes = list(mapper.images)
        for each in mapper.images.values():
            self._places.add(sight_of(vocabulary, each))
        self.recognitions: list[Recognition[VisualCandidate]] = []

    def due(self, stamps_ns: Sequence[int]) -> list[tuple[int, int]]:
        """Return keyframes that are new since the last call, each with the image of its time.

        Parameters
        ----------
        stamps_ns
            Times of the images that there are [ns].

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
        self._mapper.loops.suggest(number, "image", self.suggest(Seen(number, features)).candidates)

    def suggest(self, sensed: Seen) -> Recognition[Candidate[int]]:
        """Return the keyframe whose image shows the same place; remember this one."""
        sight = sight_of(self._places.vocabulary, sensed.features)
        recognition = self._places.suggest(sight)
        self._places.add(sight)
        self.keyframes.append(sensed.keyframe)
        self.recognitions.append(recognition)
        found = recognition.found
        if found is not None:
            return Recognition((Candidate(self.keyframes[found.place], found.pose, found.score),))
        if len(sensed.features) >= LEAST_FEATURES:
            self._mapper.images[sensed.keyframe] = Features(
                sight.points, sight.descriptors, sight.aspect
            )
        return Recognition((), recognition.refusal)
