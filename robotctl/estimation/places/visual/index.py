"""An inverted index: for each word, the images that have it.

A query costs as much as there are images with its words, not as there are images.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.grown import Grown


class InvertedIndex:
    """Images by their words, in the order in which they were added.

    Parameters
    ----------
    words
        How many words the vocabulary has.
    """

    def __init__(self, words: int) -> None:
        self._last = np.full(words, -1, np.int64)
        """The newest entry of each word."""
        self._before = Grown((), np.int64)
        """Previous entry with the same word, its image, and the word's weight there."""
        self._image, self._weight = Grown((), np.int64), Grown((), np.float64)
        self.images = 0

    def add(self, words: NDArray[np.int64], weights: NDArray[np.float64]) -> None:
        """Add an image: its distinct words and their weights."""
        begin = self._before.add(self._last[words])
        self._image.add(np.full(len(words), self.images))
        self._weight.add(weights)
        self._last[words] = np.arange(begin, begin + len(words))
        self.images += 1

    def scores(self, words: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how alike each image is, (images,), from 0 to 1.

        The sum over all words of the lesser weight, which is 1 - |v - w|/2 by the L1 norm of two
        bags (Nistér, Stewénius 2006).
        """
        result = np.zeros(self.images)
        entries = self._before.array, self._image.array, self._weight.array
        _add_scores(self._last, *entries, words, weights, result)
        return result


@compiled
def _add_scores(
    last: NDArray[np.int64],
    before: NDArray[np.int64],
    image: NDArray[np.int64],
    weight: NDArray[np.float64],
    words: NDArray[np.int64],
    weights: NDArray[np.float64],
    scores: NDArray[np.float64],
) -> None:
    """Add the lesser weight of each word to the images that have it."""
    for i in range(len(words)):
        entry = last[words[i]]
        while entry >= 0:
            scores[image[entry]] += min(weights[i], weight[entry])
            entry = before[entry]
