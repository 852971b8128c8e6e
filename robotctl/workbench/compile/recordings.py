"""Kernels that work on recordings: calibration of wheels, SLAM by landmarks."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.landmarks.models import S
from robotctl.estimation.odometry.innovations import OUTLIER, whitened_innovations
from robotctl.estimation.ranging.likelihood_config import BeamSkipping, LikelihoodFieldConfig
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.sensors.lidar import REHEARSED
from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.estimation.slam.ekf_slam.features import LINE, POINT
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.model.wall_map import WallMap


def warm_up() -> None:
    """Call each with a few numbers."""
    for kind, size in ((POINT, 3), (LINE, 3), (CAMERA_POINT, len(S))):
        slam = EkfSlam(np.zeros(size), 1e-3 * np.eye(size))
        seen, noise = np.array([[2.0, 0.5], [3.0, -0.5]]), np.tile(1e-2 * np.eye(2), (2, 1, 1))
        slam.sight(kind, [1, 2], seen, noise)
        slam.associate(kind, seen, noise)
        slam.remove(0)
    steps = np.arange(6.0)
    whitened_innovations(
        steps, np.full((5, 3), 0.1), np.zeros(3), np.ones(3), np.ones(3),
        steps[1:], np.zeros((5, 3)), np.ones(5), np.ones(3), np.zeros(2), 0.0, OUTLIER,
    )  # fmt: skip
    walls = grid_of_walls(WallMap(np.array([[0.0, 0.0, 4.0, 0.0], [4.0, 0.0, 4.0, 4.0]])))
    config = LikelihoodFieldConfig(skipping=BeamSkipping(enabled=True))
    LikelihoodField(walls, config).measurement(REHEARSED)(np.ones((2, 3)))
