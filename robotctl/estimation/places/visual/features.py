"""Features of an image: corners with binary descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.messages.estimation import ImageFeatures

Descriptors: TypeAlias = NDArray[np.uint64]
"""(n, 4): 256 bits each."""


@dataclass(frozen=True, slots=True)
class Features:
    """Features of an image.

    Parameters
    ----------
    points
        (n, 2), u and v over the image's diagonal, so images of any size compare.
    descriptors
        (n, 4), of the same features.
    aspect
        Shorter over longer side of the image.
    """

    points: NDArray[np.float64]
    descriptors: Descriptors
    aspect: float

    def __len__(self) -> int:
        return len(self.points)


def features_message(features: Features) -> ImageFeatures:
    """Return features as a message, which is also how they are kept in files."""
    points, descriptors = features.points.astype("<f4"), features.descriptors.astype("<u8")
    return ImageFeatures(points.tobytes(), descriptors.tobytes(), features.aspect)


def features_in(message: ImageFeatures) -> Features:
    """Return the features of a message.

    Raises
    ------
    ValueError
        If it is none.
    """
    points = np.frombuffer(message.points, "<f4").reshape(-1, 2).astype(np.float64)
    descriptors = np.frombuffer(message.descriptors, "<u8").reshape(len(points), 4)
    return Features(points, descriptors, message.aspect)
