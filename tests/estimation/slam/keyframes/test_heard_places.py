"""Loops by sonars: two turns on one spot say that the robot is there again."""

import math

import numpy as np
import pytest

from robotctl.estimation.slam.keyframes.heard_places import HeardPlaces
from robotctl.estimation.slam.keyframes.motion import ScanPose
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.local_scans.test_sonar import MOUNTS, heard


class Suggested:
    """A search of loops that only listens."""

    def __init__(self):
        self.candidates = []

    def suggest(self, number, found_by, candidates):
        self.candidates += [(number, found_by, each) for each in candidates]


def turn(x_m, y_m, begin_rad, way=1.0):
    """Return poses of a turn on the spot by a little more than 360 degrees."""
    angles = begin_rad + way * np.linspace(0.0, 2.05 * math.pi, 200)
    return [SE2(x_m, y_m, math.remainder(each, math.tau)) for each in angles]


def shown(places, poses, keyframe, rng, drift, begin_ns):
    """Hear a turn, by odometry that is off by `drift`; its keyframe is where it begins."""
    for reading, pose in zip(heard(OFFICE, poses, rng), poses, strict=True):
        later = reading._replace(stamp_ns=begin_ns + reading.stamp_ns)
        places.hear(later, drift @ pose)
    end = poses[0].inverse() @ poses[-1]
    places.look(ScanPose(begin_ns + 10**12, keyframe, end), drift @ poses[-1])


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
def test_a_turn_at_a_known_spot_says_where_the_robot_is_in_the_old_keyframe():
    rng, loops = np.random.default_rng(1), Suggested()
    places = HeardPlaces(MOUNTS, loops)
    spots = [(1.0, 1.0, 0.3), (12.0, 9.0, -2.0), (3.0, 9.2, 1.0)]
    for number, spot in enumerate(spots):
        shown(places, turn(*spot), number, rng, SE2(), number * 10**13)
    assert loops.candidates == []
    # Back at the second, metres off by odometry, turned otherwise, the other way round.
    again = turn(12.04, 8.97, 0.4, way=-1.0)
    shown(places, again, 7, rng, SE2(3.0, -2.0, 0.8), 4 * 10**13)
    ((number, found_by, found),) = loops.candidates
    assert (number, found.place, found_by) == (7, 1, "sonar turn")
    true = SE2(*spots[1]).inverse() @ again[0]
    assert math.hypot(found.pose.x_m - true.x_m, found.pose.y_m - true.y_m) < 0.15
    assert abs(math.remainder(found.pose.theta_rad - true.theta_rad, math.tau)) < 0.15


def test_a_robot_that_drives_says_nothing():
    rng, loops = np.random.default_rng(2), Suggested()
    places = HeardPlaces(MOUNTS, loops)
    poses = [SE2(1.0 + 0.02 * k, 1.0, 0.0) for k in range(400)]
    for begin_ns in (0, 10**13):  # the same way twice
        shown(places, poses, 0, rng, SE2(), begin_ns)
    assert loops.candidates == []
