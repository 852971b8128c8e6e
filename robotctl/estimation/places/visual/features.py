"""What describes an image: corners with binary descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Descriptors: TypeAlias = NDArray[np.uint64]
"""(n, 4): 256 bits each."""


@dataclass(frozen=True, slots=True)
class Features:
    """What describes an image.

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
