"""Recognising where an image was taken among those seen before: the camera's loop closures.

Images with the same words are candidates, the best of each stretch of images alone. Their matches
must fit one motion of the camera. Then the best counts, unless another place fits nearly as well,
or it fits weakly and the images just before did not lead to the same place.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.recogniser import Candidate, Recognition
from robotctl.estimation.places.visual.features import Descriptors, Features
from robotctl.estimation.places.visual.geometry import common_geometry
from robotctl.estimation.places.visual.index import InvertedIndex
from robotctl.estimation.places.visual.matching import match
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.model.geometry.se2 import SE2

CANDIDATES: Final = 5
"""Images whose geometry is looked at, those of most score."""
LEAST_FEATURES: Final = 50
"""Minimum features of an image that can be recognised; a plain wall has fewer."""
LEAST_LOG10_CHANCE: Final = -6.0
"""Maximum log10 of the probability that a fit is chance: one in a million."""
LEAST_SHARE: Final = 0.1
"""Share of an image's features that must fit; alike doors and lamps elsewhere are fewer."""
ALONE_SHARE: Final = 0.2
"""Share that counts without another image's word."""
RIVAL: Final = 0.6
"""Share of the best fit from which another place makes it ambiguous."""
NEAR: Final = 3
"""Images before and after one that show the same place, at least."""
REMEMBERED: Final = 3
"""Images before the last whose candidates confirm its own."""
_SCORE: Final = 0.5
"""Minimum share of the best score for an image to be a candidate."""
_FEW: Final = 100
"""Features below which shares are of this many."""
_ALIKE: Final = 0.4
"""Score from which on two images are much the same: of a camera that stands or creeps."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VisualCandidate(Candidate[int]):
    """An image that may show the same place, by its number in the order in which they were added.

    `score` is the similarity of the words; the pose is that of the image.

    Parameters
    ----------
    matches, inliers
        Features that look alike, and those that also fit one motion of the camera.
    share
        Inliers over the features of the image that has fewer.
    model
        What the motion was fitted by: `plane`, `scene` or `none`.
    """

    matches: int
    inliers: int
    share: float
    model: str


@dataclass(frozen=True, slots=True)
class Sight:
    """An image in words: its features sorted by group, and its bag.

    Parameters
    ----------
    points, descriptors, groups
        (n, 2), (n, 4), (n,).
    aspect
        Of the image.
    words, weights
        (k,) each, the bag.
    """

    points: NDArray[np.float64]
    descriptors: Descriptors
    groups: NDArray[np.int64]
    aspect: float
    words: NDArray[np.int64]
    weights: NDArray[np.float64]


def sight_of(vocabulary: Vocabulary, features: Features) -> Sight:
    """Return an image in words."""
    words, groups = vocabulary.words_of(features.descriptors)
    order = np.argsort(groups, kind="stable")
    return Sight(
        features.points[order],
        features.descriptors[order],
        groups[order],
        features.aspect,
        *vocabulary.bag_of(words),
    )


class VisualPlaces:
    """The places that a camera has seen, one for each image.

    Parameters
    ----------
    vocabulary
        Its words.
    gap
        How many of the last images are of the same visit and are not looked at.
    seed
        Of the fits.
    """

    def __init__(self, vocabulary: Vocabulary, gap: int = 10, seed: int = 0) -> None:
        self.vocabulary = vocabulary
        self._gap = gap
        self._seed = seed
        self._index = InvertedIndex(vocabulary.words)
        self._sights: list[Sight] = []
        self._reach: list[int] = []
        self._closures: list[tuple[int, int]] = []
        self._before: deque[tuple[int, ...]] = deque(maxlen=REMEMBERED)

    def __len__(self) -> int:
        return len(self._sights)

    def add(self, sight: Sight) -> None:
        """Remember an image, the next in the order of the drive."""
        scores = self._index.scores(sight.words, sight.weights)
        self._reach.append(_alike_before(scores))
        self._index.add(sight.words, sight.weights)
        self._sights.append(sight)

    def suggest(self, sensed: Sight, *, is_next: bool = True) -> Recognition[VisualCandidate]:
        """Return which images may show the same place, and why none does.

        Parameters
        ----------
        sensed
            The image.
        is_next
            Whether it follows the last image in the drive: then those of the same visit are left
            out. `add` remembers it afterwards.
        """
        if len(sensed.points) < LEAST_FEATURES:
            self._before.append(())
            return Recognition((), f"only {len(sensed.points)} features")
        scores = self._index.scores(sensed.words, sensed.weights)
        if is_next:
            scores = scores[: max(0, len(scores) - self._gap - _alike_before(scores))]
        looked_at = [self._verified(sensed, image, scores) for image in self._peaks(scores)]
        judged = self._judged(looked_at)
        self._before.append(tuple(each.place for each in looked_at if not each.refusal))
        result = Recognition(tuple(judged))
        if result.found is None:
            best = max(judged, key=lambda each: each.share, default=None)
            return replace(result, refusal=best.refusal if best else "nothing like it")
        if is_next:
            self._closures.append((len(self), result.found.place))
        return result

    def _peaks(self, scores: NDArray[np.float64]) -> list[int]:
        """Return the images of most score, without those near a better one."""
        peaks: list[int] = []
        least = _SCORE * float(scores.max(initial=0.0))
        for image in np.argsort(-scores, kind="stable")[: 10 * CANDIDATES].tolist():
            if scores[image] <= least or len(peaks) == CANDIDATES:
                break
            if not any(self._are_near(image, other) for other in peaks):
                peaks.append(image)
        return peaks

    def _are_near(self, image: int, other: int) -> bool:
        """Return whether two images are of one stretch that shows the same place."""
        return abs(image - other) <= max(NEAR, self._reach[max(image, other)])

    def _verified(self, sight: Sight, image: int, scores: NDArray[np.float64]) -> VisualCandidate:
        """Return a candidate, refused if its geometry does not fit."""
        known = self._sights[image]
        pairs = match(sight.descriptors, sight.groups, known.descriptors, known.groups)
        fewer = max(_FEW, min(len(sight.points), len(known.points)))
        if len(pairs) < LEAST_SHARE * fewer:
            score = float(scores[image])
            return VisualCandidate(
                image, SE2(), score, "few features match",
                matches=len(pairs), inliers=0, share=0.0, model="none",
            )  # fmt: skip
        fit = common_geometry(
            sight.points[pairs[:, 0]],
            known.points[pairs[:, 1]],
            known.aspect,
            np.random.default_rng([self._seed, len(self), image]),
        )
        share = len(fit.inliers) / fewer
        refusal = ""
        if fit.log10_chance > LEAST_LOG10_CHANCE:
            refusal = "no common geometry"
        elif share < LEAST_SHARE:
            refusal = "too little in common"
        return VisualCandidate(
            image, SE2(), float(scores[image]), refusal,
            matches=len(pairs), inliers=len(fit.inliers), share=share, model=fit.model,
        )  # fmt: skip

    def _judged(self, looked_at: Sequence[VisualCandidate]) -> list[VisualCandidate]:
        """Return the candidates; at most one is left that is not refused."""
        fitting = [each for each in looked_at if not each.refusal]
        if not fitting:
            return list(looked_at)
        best = max(fitting, key=lambda each: each.share)
        refusal = ""
        if any(
            each.share > RIVAL * best.share and not self._are_one_place(each.place, best.place)
            for each in looked_at
            if each is not best
        ):
            refusal = "ambiguous"
        elif best.share < ALONE_SHARE and not any(
            self._are_near(best.place, earlier) for found in self._before for earlier in found
        ):
            refusal = "not confirmed by the images before"
        return [
            replace(
                each, refusal=each.refusal or (refusal if each is best else "another fits better")
            )
            for each in looked_at
        ]

    def _are_one_place(self, image: int, other: int) -> bool:
        """Return whether two images are near, or of places known to be the same by a closure."""
        return self._are_near(image, other) or any(
            (self._are_near(image, a) and self._are_near(other, b))
            or (self._are_near(image, b) and self._are_near(other, a))
            for a, b in self._closures
        )


def _alike_before(scores: NDArray[np.float64]) -> int:
    """Return how many of the last images are much the same as a new one, without a break."""
    differ = np.flatnonzero(scores[::-1] < _ALIKE)
    return int(differ[0]) if len(differ) else len(scores)
