"""Loops by a camera: each keyframe has an image, recognised among those before it."""

from __future__ import annotations

from typing import Final

from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.places.visual.recognition import (
    VisualPlaces,
    VisualRecognition,
    sight_of,
)
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.estimation.slam.keyframes.loops import Hint, LoopSearch
from robotctl.model.geometry.se2 import SE2

IMAGE_NS: Final = 300_000_000
"""An image shows what a keyframe saw, if it was taken within this time of it [ns]."""
_SHIFT_M: Final = 1.5
_TURN_RAD: Final = 0.5
"""How far from the place of an image that fits another the robot may be."""


class SeenPlaces:
    """Tells a mapper's search of loops which images look like the place of an older one.

    Attributes
    ----------
    keyframes
        Whose images were looked at, in their order.
    recognitions
        What each was recognised as; candidates are numbers of images in `keyframes`.

    Parameters
    ----------
    vocabulary
        Its words.
    loops
        Where to look for loops; scans bear out what the camera says.
    """

    def __init__(self, vocabulary: Vocabulary, loops: LoopSearch) -> None:
        self._places = VisualPlaces(vocabulary)
        self._loops = loops
        self.keyframes: list[int] = []
        self.recognitions: list[VisualRecognition] = []

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
            self._loops.suggest(Hint(number, old, "image", SE2(), _SHIFT_M, _TURN_RAD))
