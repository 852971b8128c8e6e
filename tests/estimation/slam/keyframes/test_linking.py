"""New keyframes are linked with those beside them, as far as the map allows."""

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.keyframes.linking import Linking
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.local_scans.sonar import SOURCE
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.lidar_world import box, scan_of

ROOM = np.concatenate([box(0.0, 0.0, 5.0, 4.0), box(3.0, 0.0, 0.6, 0.8), box(0.0, 2.5, 0.4, 0.7)])
AROUND = np.radians(np.arange(-180.0, 180.0, 2.0))


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
@pytest.mark.parametrize(("sigma_rad", "is_linked"), [(0.07, True), (0.01, False)])
def test_a_match_with_a_known_place_lies_within_three_times_the_doubt(sigma_rad, is_linked):
    rng, poses = np.random.default_rng(1), [SE2(2.0, 1.5, 0.0), SE2(2.2, 1.7, 0.3)]
    scans = [scan_of(ROOM, pose, rng, angles=AROUND) for pose in poses]
    keyframes = [Keyframe(each, 9.0 * n) for n, each in enumerate(scans)]
    back_end, true = BackEnd(), poses[0].inverse() @ poses[1]
    turned = SE2(true.x_m, true.y_m, true.theta_rad + 0.15)
    for pose in (SE2(), turned):
        back_end.add(pose)
    back_end.link(KeyframeLink(0, 1, turned, np.diag([900.0, 900.0, sigma_rad**-2])))
    growing = GrowingMap(SOURCE.config, keyframes, back_end)
    Linking(growing, LoopSearch(growing)).link_near(1, [], 0.0)
    links = back_end.links[1:]
    assert len(links) == is_linked
    for link in links:
        assert link.is_loop
        assert link.pose.theta_rad == pytest.approx(true.theta_rad, abs=0.02)
