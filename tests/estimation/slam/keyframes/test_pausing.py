"""Mapping paused: the map stays as it is, the robot is still found on it."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, drifting, scan_of

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


@pytest.mark.parametrize("is_live", [True, False])
def test_a_paused_map_stays_and_goes_on_later(is_live):
    rng = np.random.default_rng(4)
    there = along([(1.0, 1.0), (9.0, 1.0)])
    poses = there + there[::-1] + along([(1.0, 1.0), (13.0, 1.0), (13.0, 6.0)])
    odometry = drifting(poses, rng)
    mapper, back, again = SlamMapper(KeyframeConfig(is_live=is_live)), len(there), 2 * len(there)
    for row, pose in enumerate(poses):
        if row == back:
            mapper.is_paused, known = True, list(mapper.keyframes)
            links = len(mapper.back_end.links)
        if row == again:
            assert mapper.keyframes == known
            assert len(mapper.back_end.links) == links
            mapper.is_paused = False
        mapper.add(scan_of(OFFICE, pose, rng, stamp_ns=row * 500_000_000), odometry[row])
        found, true = mapper.pose, poses[0].inverse() @ pose
        assert np.hypot(found.x_m - true.x_m, found.y_m - true.y_m) < 0.08
    assert len(mapper.keyframes) > len(known)
    assert mapper.keyframes[: len(known)] == known or is_live  # a live one may renew some
