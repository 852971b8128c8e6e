"""Goals: a position, perhaps with a heading."""

from __future__ import annotations

import math
from typing import NamedTuple

from robotctl.model.geometry.se2 import SE2


class Goal(NamedTuple):
    """A place of `world` to drive to [m], and the heading there [rad]; None: any."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
    tolerance_m: float | None = None
    """Distance within which it counts as reached [m]; None: that of the local controller."""

    @property
    def opposite(self) -> Goal:
        """The same with the heading of a robot that is turned round."""
        if self.heading_rad is None:
            return self
        return self._replace(heading_rad=self.heading_rad + math.pi)

    def seen_from(self, pose: SE2) -> SE2:
        """Return it as a pose: where any heading will do, that in which a robot would come."""
        if self.heading_rad is None:
            return facing(pose, self.x_m, self.y_m)
        return SE2(self.x_m, self.y_m, self.heading_rad)


def facing(start: SE2, x_m: float, y_m: float) -> SE2:
    """Return a place with the heading in which a straight path would come to it."""
    return SE2(x_m, y_m, math.atan2(y_m - start.y_m, x_m - start.x_m))
