"""A vocabulary of visual words: a tree whose leaves are the words.

Descriptors go down the tree to the child whose centre differs by the fewest bits (Nistér,
Stewénius, CVPR 2006; for binary descriptors Gálvez-López, Tardós, IEEE T-RO 28(5), 2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.errors import InvalidValue
from robotctl.estimation.places.visual.bits import BITS, differing_bits
from robotctl.estimation.places.visual.features import Descriptors


@dataclass(frozen=True)
class Vocabulary:
    """A tree of visual words.

    Parameters
    ----------
    centres
        (nodes, 4), of each node, breadth first; the root's has no meaning.
    first
        (nodes + 1,): children of node i are `first[i]` up to before `first[i + 1]`; words have
        none.
    idf
        (words,): weight of each word, the log of the training images over those that have it.

    Raises
    ------
    InvalidValue
        If these are no such tree.
    """

    centres: Descriptors
    first: NDArray[np.int64]
    idf: NDArray[np.float64]

    def __post_init__(self) -> None:
        nodes = len(self.centres)
        first = self.first
        if self.centres.shape != (nodes, 4) or first.shape != (nodes + 1,) or nodes < 3:
            raise InvalidValue("first", "must have one entry more than there are nodes", first)
        grows = np.all(np.diff(first) >= 0) and np.all(first[:-1] > np.arange(nodes))
        if not grows or first[0] != 1 or first[-1] != nodes:
            raise InvalidValue("first", "must lead from each node to later ones, once each", first)
        if self.idf.shape != (self.words,) or not np.all(np.isfinite(self.idf) & (self.idf >= 0)):
            raise InvalidValue("idf", f"must be {self.words} weights of 0 or more", self.idf)

    @property
    def words(self) -> int:
        """How many words there are."""
        return int(np.count_nonzero(np.diff(self.first) == 0))

    @cached_property
    def _word_of(self) -> NDArray[np.int64]:
        """(nodes,): the number of the word that a node is, among all words."""
        is_word = np.diff(self.first) == 0
        numbers: NDArray[np.int64] = np.cumsum(is_word) - 1
        return numbers

    def words_of(self, descriptors: Descriptors) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the word of each descriptor, and the child of the root above it, (n,) each.

        Features below different children hardly ever are of one corner.
        """
        leaves, groups = _descend(self.centres, self.first, descriptors)
        return self._word_of[leaves], groups

    def bag_of(self, words: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the distinct words of an image, and their weights by tf-idf, which add up to 1."""
        distinct, counts = np.unique(words, return_counts=True)
        weights = counts * self.idf[distinct]
        total = float(weights.sum())
        if total == 0.0:
            return np.empty(0, np.int64), np.empty(0)
        return distinct, weights / total


@compiled
def _descend(
    centres: NDArray[np.uint64], first: NDArray[np.int64], descriptors: NDArray[np.uint64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the leaf of each descriptor, and the child of the root above it."""
    n = len(descriptors)
    leaves = np.empty(n, np.int64)
    groups = np.empty(n, np.int64)
    for i in range(n):
        node = group = 0
        while first[node] < first[node + 1]:
            least = BITS + 1
            nearest = 0
            for child in range(first[node], first[node + 1]):
                bits = differing_bits(centres[child], descriptors[i])
                if bits < least:
                    least, nearest = bits, child
            node = nearest
            if group == 0:
                group = node
        leaves[i] = node
        groups[i] = group
    return leaves, groups
