"""The kinds of factors by name; a new one is a file and a line here."""

from __future__ import annotations

from typing import Final

from robotctl.estimation.slam.factors.between import BETWEEN_2D, BETWEEN_3D
from robotctl.estimation.slam.factors.ground_point import GROUND_POINT
from robotctl.estimation.slam.factors.landmarks import BEARING, RANGE, RANGE_BEARING, SEEN_2D
from robotctl.estimation.slam.factors.odometry_arc import ODOMETRY_ARC
from robotctl.estimation.slam.factors.points_in_space import RANGE_3D, SEEN_3D
from robotctl.estimation.slam.factors.prior import (
    POSITION_2D,
    POSITION_3D,
    PRIOR_2D,
    PRIOR_3D,
    PRIOR_POINT_2D,
    PRIOR_POINT_3D,
)
from robotctl.estimation.slam.graph.factor import FactorKind

FACTORS: Final[dict[str, FactorKind]] = {
    "between_2d": BETWEEN_2D,
    "between_3d": BETWEEN_3D,
    "prior_2d": PRIOR_2D,
    "prior_3d": PRIOR_3D,
    "prior_point_2d": PRIOR_POINT_2D,
    "prior_point_3d": PRIOR_POINT_3D,
    "position_2d": POSITION_2D,
    "position_3d": POSITION_3D,
    "range_bearing": RANGE_BEARING,
    "bearing": BEARING,
    "range": RANGE,
    "seen_2d": SEEN_2D,
    "seen_3d": SEEN_3D,
    "range_3d": RANGE_3D,
    "odometry_arc": ODOMETRY_ARC,
    "ground_point": GROUND_POINT,
}
