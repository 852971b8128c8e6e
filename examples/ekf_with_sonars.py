"""An extended Kalman filter that corrects drifting odometry by four sonars and the walls of a room.

python examples/ekf_with_sonars.py
"""

import math
from itertools import pairwise

import numpy as np

from robotctl.estimation import EkfConfig, PoseEkf
from robotctl.estimation.kalman.ekf_models import wall_range
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.model import SE2, PoseEstimate, SonarMount, WallMap, arc
from robotctl.model.geometry.localisation import LocalisationStatus

corners = [(0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0), (0.0, 0.0)]
walls = WallMap(np.array([(*a, *b) for a, b in pairwise(corners)]))
mounts = [SonarMount(f"at {deg}", 0.0, 0.0, deg) for deg in (0.0, 90.0, 180.0, -90.0)]
rng = np.random.default_rng(1)

truth = odometry = SE2(2.5, 1.0, 0.0)
start = PoseEstimate(0, truth, 0.01 * np.eye(3), LocalisationStatus.LOCALISED)
ekf = PoseEkf(EkfConfig(), start)
for step in range(1, 601):  # one minute on a circle of 1 m radius, wheels that err by 2 %
    stamp_ns = step * 100_000_000
    truth = arc(truth, 0.03, 0.03)
    odometry = arc(odometry, 0.0306, 0.0294)
    ekf.predict(stamp_ns, 0.0306, 0.0294)
    for mount in mounts:
        seen = wall_range(truth, mount, walls, SonarModelConfig())
        if seen is not None:
            ekf.update_sonar(stamp_ns, mount, seen[0] + rng.normal(0.0, 0.01), walls)
for name, found in (("odometry", odometry), ("EKF", ekf.estimate().pose)):
    print(f"{name}: off by {math.hypot(found.x_m - truth.x_m, found.y_m - truth.y_m):.3f} m")
