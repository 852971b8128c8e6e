"""The verdict on a map while it is made: told when it changes, once."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.verdict.watch import VerdictWatch
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE, ROUND
from tests.estimation.slam.lidar_world import along, drifting, scan_of

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_wheels_of_another_size_are_told_once_and_sound_ones_never(scale):
    rng = np.random.default_rng(7)
    poses = along(ROUND)
    mapper = SlamMapper(KeyframeConfig(is_live=True))
    watch, told = VerdictWatch(mapper), []
    for number, (pose, at) in enumerate(zip(poses, drifting(poses, rng), strict=True)):
        wheels = SE2(scale * at.x_m, scale * at.y_m, at.theta_rad)
        mapper.add(scan_of(OFFICE, pose, rng, stamp_ns=number * 500_000_000), wheels)
        told += watch.add(wheels)
    off = mapper.pose.inverse() @ (poses[0].inverse() @ poses[-1])
    assert np.hypot(off.x_m, off.y_m) < 0.1
    if scale == 1.0:
        assert told == []
        assert watch.said == "good"
        return
    assert len(told) == 1
    assert "verdict on the map: doubtful because odometry contradicts the scans" in told[0]
    assert watch.said.startswith("doubtful because distance by odometry is 1.5")
