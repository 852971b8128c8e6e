"""Mountings of sonars as an array; separate, because the control process loads no numpy."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from robotctl.model.sensors.sonar import SonarMount


def mount_rows(mounts: Iterable[SonarMount]) -> NDArray[np.float64]:
    """Return x, y and direction of each sonar in `base`, (k, 3) [m, m, rad]."""
    return np.array([(m.x_m, m.y_m, m.heading_rad) for m in mounts]).reshape(-1, 3)
