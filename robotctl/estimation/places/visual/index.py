"""An inverted index: for each word, the images that have it.

A query costs as much as there are images with its words, not as there are images.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled

_BEGIN = 4096
"""Entries for which there is room at first."""


class InvertedIndex:
    """Images by their words, in the order in which they were added.

    Parameters
    ----------
    words
        How many words the vocabulary has.
    """

    def __init__(self, words: int) -> None:
        self._last = np.full(words, -1, np.int64)
        self._before = np.empty(_BEGIN, np.int64)
        self._image = np.empty(_BEGIN, np.int64)
        self._weight = np.empty(_BEGIN)
        self._entries = 0
        self.images = 0

    def add(self, words: NDArray[np.int64], weights: NDArray[np.float64]) -> None:
        """Add an image: its distinct words and their weights."""
        end = self._entries + len(words)
        while end > len(self._weight):
            self._before = np.concatenate([self._before, np.empty_like(self._before)])
            self._image = np.concatenate([self._image, np.empty_like(self._image)])
            self._weight = np.concatenate([self._weight, np.empty_like(self._weight)])
        new = slice(self._entries, end)
        self._before[new] = self._last[words]
        self._image[new] = self.images
        self._weight[new] = weights
        self._last[words] = np.arange(self._entries, end)
        self._entries = end
        self.images += 1

    def scores(self, words: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how alike each image is, (images,), from 0 to 1.

        The sum over all words of the lesser weight, which is 1 - |v - w|/2 by the L1 norm of two
        bags (Nistér, Stewénius 2006).
        """
        result = np.zeros(self.images)
        _add_scores(self._last, self._before, self._image, self._weight, words, weights, result)
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
