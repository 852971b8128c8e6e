"""A cost map for planners: obstacles grown by the robot's radius, with costs that fall off beyond.

The costs are those of nav2 (docs.nav2.org, Inflation Layer), so that its planners' settings carry
over. With d the distance from a cell's centre to that of the nearest obstacle, exact and Euclidean:

    254                                     an obstacle
    253                                     d <= robot radius: the robot would touch it
    252 exp(-scaling (d - robot radius))    up to the inflation radius, rounded down
    0                                       beyond
    255                                     unknown, where it is farther than the robot's radius

It is right for a round robot about `base`; for another shape the radius is that of the circle
around it, which closes passages that it could take lengthwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.grid_map import GridMap

FREE_COST: Final = 0
INSCRIBED: Final = 253
LETHAL: Final = 254
NO_INFORMATION: Final = 255


@dataclass(frozen=True, slots=True)
class CostMapConfig:
    """How obstacles grow.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    robot_radius_m: float = 0.25
    """Radius of the circle around `base` that holds the robot [m]."""
    inflation_radius_m: float = 0.55
    """Distance from obstacles beyond which cells cost nothing [m]; at least the robot's radius."""
    scaling_per_m: float = 10.0
    """How fast costs fall [1/m]; the greater, the closer paths pass obstacles."""
    occupied_percent: int = 65
    """Cells are obstacles from this probability on [%], 1 to 100."""

    def __post_init__(self) -> None:
        for key in ("robot_radius_m", "scaling_per_m"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and >= 0, found {getattr(self, key)}")
        if not self.robot_radius_m <= self.inflation_radius_m < math.inf:
            raise ValueError(
                f"inflation_radius_m must be finite and >= robot_radius_m = {self.robot_radius_m}, "
                f"found {self.inflation_radius_m}"
            )
        if not 1 <= self.occupied_percent <= 100:
            raise ValueError(f"occupied_percent must be 1 to 100, found {self.occupied_percent}")


@dataclass(frozen=True, slots=True, eq=False)
class CostMap:
    """Costs of a map's cells.

    Parameters
    ----------
    costs
        (rows, columns) uint8, in the cells of `grid`.
    grid
        The map that they are of.
    """

    costs: NDArray[np.uint8]
    grid: GridMap

    def cost_at(self, points_world: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the cost at each point (n, 2) [m], (n,); outside of the map `NO_INFORMATION`."""
        cells = self.grid.cell_of(points_world)
        inside = np.all((cells >= 0) & (cells < self.costs.shape), axis=1)
        result = np.full(len(cells), NO_INFORMATION, np.uint8)
        result[inside] = self.costs[tuple(cells[inside].T)]
        return result


def cost_map(grid: GridMap, config: CostMapConfig | None = None) -> CostMap:
    """Return the cost map of an occupancy grid."""
    config = config or CostMapConfig()
    obstacle = grid.occupied(config.occupied_percent)
    if obstacle.any():
        distance_m = ndimage.distance_transform_edt(~obstacle) * grid.resolution_m
    else:
        distance_m = np.full(obstacle.shape, np.inf)
    # Distances between centres are multiples of a cell's side; rounding must not break a tie.
    touching = distance_m <= config.robot_radius_m * (1.0 + 1e-9)
    beyond_m = np.maximum(distance_m - config.robot_radius_m, 0.0)
    costs = np.floor((INSCRIBED - 1) * np.exp(-config.scaling_per_m * beyond_m))
    costs[distance_m > config.inflation_radius_m * (1.0 + 1e-9)] = FREE_COST
    costs[grid.cells < 0] = NO_INFORMATION
    costs[touching] = INSCRIBED
    costs[obstacle] = LETHAL
    return CostMap(costs.astype(np.uint8), grid)
