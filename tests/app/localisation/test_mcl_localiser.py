"""A search of the map goes on over many steps of navigation, and misses no recognised place."""

import math
from types import SimpleNamespace

import msgspec
import numpy as np

from robotctl.app.localisation.localiser import LocaliserInput
from robotctl.app.localisation.mcl_localiser import MclLocaliser
from robotctl.app.localisation.place_watch import Fix
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from tests.mavlink.conftest import CONTROL

ROOM = free_poses(GridMap(np.zeros((100, 200), np.int8), 0.1))
STEP = SE2(0.02, 0.0, 0.02)
STEP_NS = 50_000_000
START = SE2(4.0, 6.0, 0.5)
TURNED = 1


class Counted:
    """A sensor that sees nothing; it counts the poses that it is asked about."""

    def __init__(self):
        self.poses = 0

    def source(self, name, measured):
        return name

    def measurement(self, name, measured):
        def log_likelihood(poses):
            self.poses += len(poses)
            return np.zeros(len(poses))

        return log_likelihood


class OnePlace:
    """Recognises a place once, while the robot drives on."""

    def hear(self, reading, odometry):
        if reading.stamp_ns != TURNED * STEP_NS:
            return None
        true = START @ odometry

        def log_likelihood(poses):
            off = poses - (true.x_m, true.y_m, true.theta_rad)
            off[:, 2] -= math.tau * np.round(off[:, 2] / math.tau)
            return -0.5 * np.sum((off / (0.05, 0.05, 0.03)) ** 2, axis=1)

        return Fix(reading.stamp_ns, log_likelihood)

    def take_notices(self):
        return []


LIDAR_ONLY = LocalisationConfig(sensors=("lidar",))


def test_a_place_that_is_recognised_during_a_search_is_used_when_there_is_time():
    history, sensor = OdometryHistory(), Counted()
    mcl = MonteCarloLocaliser(MclConfig(), ROOM, np.random.default_rng(1))
    localiser = MclLocaliser(mcl, sensor, LIDAR_ONLY, history, OnePlace())
    odometry, busy = SE2(), 0
    for step in range(60):
        now_ns = step * STEP_NS
        history.add(now_ns, odometry)
        control = msgspec.structs.replace(
            CONTROL,
            stamp_ns=now_ns,
            x_m=odometry.x_m,
            y_m=odometry.y_m,
            theta_rad=odometry.theta_rad,
        )
        reading = SimpleNamespace(stamp_ns=now_ns)
        before = sensor.poses
        seen = {"lidar": [reading] if step <= TURNED else [], "sonar": [reading]}
        state = localiser.step(control, LocaliserInput(seen), now_ns)
        assert sensor.poses - before <= 15_000  # a slice more than the bound, at most
        busy += sensor.poses > before
        odometry = odometry @ STEP
    assert busy > TURNED  # so the place came in the middle of the search
    true = START @ control.T_odom_base
    at = state.T_world_odom @ control.T_odom_base
    assert math.hypot(at.x_m - true.x_m, at.y_m - true.y_m) < 0.2
