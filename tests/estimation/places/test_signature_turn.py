"""Signatures that a turning robot collects, in rooms whose depths are known in closed form."""

import math

import numpy as np
import pytest

from robotctl.estimation.places.signature_turn import TurnCollector, TurnConfig
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount, SonarReading

CONFIG = SignatureConfig(bearings=36)
MOUNTS = (
    SonarMount("front", 0.2, 0.0, 0.0),
    SonarMount("left", 0.0, 0.15, 90.0),
    SonarMount("askew", 0.1, -0.1, -60.0),
)
WALL_M = 2.0
STEP_RAD = math.radians(1.0)


def reading(pose, stamp_ns=0):
    """Return ranges along the sonars' axes to a circular wall about the origin."""
    ranges = []
    for mount in MOUNTS:
        sonar = pose @ SE2(mount.x_m, mount.y_m, mount.heading_rad)
        ahead = sonar.x_m * math.cos(sonar.theta_rad) + sonar.y_m * math.sin(sonar.theta_rad)
        off2 = sonar.x_m**2 + sonar.y_m**2
        ranges.append(-ahead + math.sqrt(ahead**2 + WALL_M**2 - off2))
    return SonarReading(stamp_ns, tuple(ranges))


def turned(collector, poses):
    """Add a reading at each pose; return the turns."""
    found = [collector.add(reading(pose, k), pose) for k, pose in enumerate(poses)]
    return [turn for turn in found if turn is not None]


def test_sonars_anywhere_on_the_robot_see_the_depth_from_its_base():
    poses = [SE2(0.0, 0.0, k * STEP_RAD) for k in range(400)]
    (turn,) = turned(TurnCollector(MOUNTS, CONFIG), poses)
    assert np.allclose(turn.signature.depth_m, WALL_M)
    assert np.all(turn.signature.silence == 0.0)
    assert turn.stamp_ns == 360
    assert turn.odometry == poses[360]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_bearings_are_those_from_base_at_the_end_of_the_turn(sense):
    mounts = (SonarMount("front", 0.0, 0.0, 0.0),)
    collector = TurnCollector(mounts, CONFIG)
    start, turn = 0.7, None
    for k in range(400):
        theta = start + sense * k * STEP_RAD
        near = abs(math.remainder(theta - 2.0, math.tau)) < math.radians(4.0)
        turn = collector.add(SonarReading(k, (1.0 if near else math.inf,)), SE2(5.0, 1.0, theta))
        if turn is not None:
            break
    assert turn is not None
    at = math.remainder(2.0 - turn.odometry.theta_rad, math.tau) % math.tau
    heard = np.flatnonzero(turn.signature.silence < 1.0)
    assert int(at / math.tau * CONFIG.bearings) in heard
    assert len(heard) <= 2
    assert turn.signature.echoes < 0.1


def test_a_robot_that_shifts_while_it_turns_still_sees_one_depth():
    poses = [SE2(5e-5 * k, -3e-5 * k, k * STEP_RAD) for k in range(400)]
    (turn,) = turned(TurnCollector(MOUNTS, CONFIG), poses)
    end = turn.odometry
    bearings = (np.arange(36) + 0.5) * math.tau / 36 + end.theta_rad
    ahead = end.x_m * np.cos(bearings) + end.y_m * np.sin(bearings)
    expected = -ahead + np.sqrt(ahead**2 + WALL_M**2 - end.x_m**2 - end.y_m**2)
    assert np.allclose(turn.signature.depth_m, expected, atol=0.003)


def test_a_robot_that_drives_in_a_circle_completes_no_turn():
    poses = [SE2(0.5 * math.sin(a), 0.5 - 0.5 * math.cos(a), a) for a in np.arange(0.0, 20.0, 0.02)]
    collector = TurnCollector(MOUNTS, CONFIG)
    assert not turned(collector, poses)
    assert collector.turned_rad < 0.3


def test_turning_to_and_fro_is_no_round_however_often():
    swing = [SE2(0.0, 0.0, math.sin(0.02 * k)) for k in range(1500)]
    collector = TurnCollector(MOUNTS, CONFIG)
    assert not turned(collector, swing)
    assert collector.turned_rad == pytest.approx(2.0, abs=0.01)


def test_there_and_back_is_counted_once_and_completed_beyond_where_it_began():
    there = [SE2(0.0, 0.0, k * STEP_RAD) for k in range(241)]
    back = [SE2(0.0, 0.0, (240 - k) * STEP_RAD) for k in range(1, 241)]
    collector = TurnCollector(MOUNTS, CONFIG)
    assert not turned(collector, there + back)
    assert collector.turned_rad == pytest.approx(240 * STEP_RAD)
    beyond = [SE2(0.0, 0.0, -k * STEP_RAD) for k in range(1, 150)]
    (turn,) = turned(collector, beyond)
    assert beyond.index(turn.odometry) + 1 == 120
    assert turn.signature.seen.all()
    assert np.allclose(turn.signature.depth_m, WALL_M)


def test_each_round_gives_a_signature_and_what_was_before_on_the_way_does_not_count():
    way = [SE2(0.01 * k - 1.0, 0.0, 0.0) for k in range(100)]
    rounds = [SE2(0.0, 0.0, math.remainder(k * STEP_RAD, math.tau)) for k in range(900)]
    turns = turned(TurnCollector(MOUNTS, CONFIG), way + rounds)
    assert len(turns) == 2
    assert turns[0].stamp_ns == 100 + 360
    assert np.allclose(turns[0].signature.depth_m, WALL_M, atol=0.12)


def test_a_robot_that_stands_still_for_long_needs_a_whole_turn_afterwards():
    stand = [SE2() for _ in range(5000)]
    rounds = [SE2(0.0, 0.0, k * STEP_RAD) for k in range(400)]
    (turn,) = turned(TurnCollector(MOUNTS, CONFIG), stand + rounds)
    assert turn.stamp_ns == 5000 + 360


def test_readings_that_did_not_come_are_no_silence():
    mounts = (SonarMount("front", 0.0, 0.0, 0.0), SonarMount("broken", 0.0, 0.0, 90.0))
    collector = TurnCollector(mounts, CONFIG, TurnConfig(round_rad=math.radians(90.0)))
    turn = None
    for k in range(92):
        turn = turn or collector.add(SonarReading(k, (1.0, math.nan)), SE2(0, 0, k * STEP_RAD))
    assert turn is not None
    assert np.count_nonzero(turn.signature.seen) in (9, 10)


def test_a_reading_of_other_sonars_is_refused():
    with pytest.raises(ValueError, match="each of 3 sonars, found 1"):
        TurnCollector(MOUNTS, CONFIG).add(SonarReading(0, (1.0,)), SE2())


def test_settings_out_of_range_are_refused():
    with pytest.raises(ValueError, match="spot_m"):
        TurnConfig(spot_m=0.0)
