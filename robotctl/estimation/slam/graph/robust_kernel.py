"""Cost and weight of a factor that may be wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robotctl.estimation.slam.graph.variables import Floats


@dataclass(frozen=True, slots=True, eq=False)
class RobustKernel:
    """A robust kernel.

    Parameters
    ----------
    cost, weight
        Of squares s (n,) and the scale c^2, (n,).
    """

    cost: Callable[[Floats, float], Floats]
    weight: Callable[[Floats, float], Floats]
