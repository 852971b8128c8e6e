"""A vocabulary from images: descriptors are divided into clusters, these again, and so on."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import InvalidValue
from robotctl.estimation.places.visual.features import Descriptors
from robotctl.estimation.places.visual.vocabulary import Vocabulary

BRANCHES: Final = 10
LEVELS: Final = 4
"""10 000 words at most, 0.4 MB."""
_ROUNDS: Final = 20
"""Maximum rounds of assignment to the nearest centre."""


def train(
    images: Sequence[Descriptors],
    rng: np.random.Generator,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Vocabulary:
    """Divide the descriptors of all images into a tree of words.

    The centre of a cluster has each bit as most of its descriptors have it, the first centres are
    drawn far from each other (k-means++: Arthur, Vassilvitskii, SODA 2007).

    Parameters
    ----------
    images
        Descriptors of each training image, (n, 4).
    rng
        Draws the first centres.
    progress
        Called with how many descriptors went down how many levels in all, and the total.

    Raises
    ------
    InvalidValue
        If there are too few descriptors to divide.
    """
    descriptors = np.concatenate([np.empty((0, 4), np.uint64), *images])
    image_of = np.repeat(np.arange(len(images)), [len(each) for each in images])
    if len(descriptors) < BRANCHES**2:
        raise InvalidValue(
            "images", f"must have {BRANCHES**2} features or more, found {len(descriptors)}", images
        )
    centres, first, idf = [np.zeros(4, np.uint64)], [], []
    waiting = deque([(np.arange(len(descriptors)), 0)])
    done = 0
    while waiting:
        members, level = waiting.popleft()
        first.append(len(centres))
        clusters = [] if level == LEVELS else _clusters(descriptors[members], rng)
        for centre, inside in clusters:
            centres.append(centre)
            waiting.append((members[inside], level + 1))
        done += len(members) * (1 if clusters else LEVELS + 1 - level)
        if not clusters:
            idf.append(math.log(len(images) / len(np.unique(image_of[members]))))
        progress(done, (LEVELS + 1) * len(descriptors))
    first.append(len(centres))
    return Vocabulary(np.array(centres), np.array(first), np.array(idf))


def _clusters(
    descriptors: Descriptors, rng: np.random.Generator
) -> list[tuple[Descriptors, NDArray[np.bool_]]]:
    """Return centres, and which descriptors belong to each; none where all are much the same."""
    distinct = np.unique(descriptors, axis=0)
    if len(distinct) <= BRANCHES:
        centres = distinct
        nearest = np.argmin(_distances(descriptors, centres), axis=1)
    else:
        bits = np.unpackbits(descriptors.view(np.uint8), axis=1)
        centres = _spread(descriptors, rng)
        nearest = np.argmin(_distances(descriptors, centres), axis=1)
        for _ in range(_ROUNDS):
            centres = _majorities(bits, nearest, centres)
            before, nearest = nearest, np.argmin(_distances(descriptors, centres), axis=1)
            if np.array_equal(before, nearest):
                break
    found = [(centre, nearest == i) for i, centre in enumerate(centres)]
    found = [each for each in found if each[1].any()]
    return found if len(found) > 1 else []


def _spread(descriptors: Descriptors, rng: np.random.Generator) -> Descriptors:
    """Draw first centres, each with a probability as the squared distance from the others."""
    centres = [descriptors[rng.integers(len(descriptors))]]
    least = _distances(descriptors, centres[0][None])[:, 0].astype(np.float64)
    for _ in range(1, BRANCHES):
        drawn = rng.choice(len(descriptors), p=least**2 / np.sum(least**2))
        centres.append(descriptors[drawn])
        least = np.minimum(least, _distances(descriptors, descriptors[drawn][None])[:, 0])
    return np.array(centres)


def _majorities(
    bits: NDArray[np.uint8], nearest: NDArray[np.int64], centres: Descriptors
) -> Descriptors:
    """Return the centres whose bits are those of most members; of an empty cluster, the old one."""
    result = centres.copy()
    for i in range(len(centres)):
        members = bits[nearest == i]
        if len(members):
            most = 2 * members.sum(axis=0, dtype=np.int64) > len(members)
            result[i] = np.packbits(most).view(np.uint64)
    return result


def _distances(descriptors: Descriptors, centres: Descriptors) -> NDArray[np.int64]:
    """(n, k): bits by which each descriptor differs from each centre."""
    result = np.zeros((len(descriptors), len(centres)), np.int64)
    for i in range(4):
        result += np.bitwise_count(descriptors[:, i, None] ^ centres[None, :, i])
    return result
