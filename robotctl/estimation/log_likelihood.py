"""What a measurement says of poses: the one function by which sensors plug into the localiser."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

LogLikelihood: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""From poses of `base` in `world`, (n, 3) [m, m, rad], to the log-likelihood of one measurement at
each, (n,), up to a constant that is the same for all poses."""
