"""Ranges of the sonars."""

import math

import pytest
from pymavlink.dialects.v20 import common

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.model.sensors.sonar import SonarMount


def test_each_sonar_has_a_message_with_its_number_and_orientation(bench):
    bench.run(0.3, sonar_m=(1.0, math.inf, math.nan, 0.125, 1.0, 1.0, 1.0, 9.0))
    sensors = {message.id: message for message in bench.messages("DISTANCE_SENSOR")}
    assert set(sensors) == {0, 1, 3, 4, 5, 6, 7}  # 2 is faulty
    assert sensors[0].orientation == common.MAV_SENSOR_ROTATION_NONE
    assert sensors[1].orientation == common.MAV_SENSOR_ROTATION_YAW_315  # 45 to the left
    assert sensors[6].orientation == common.MAV_SENSOR_ROTATION_YAW_90  # right
    assert sensors[0].current_distance == 100
    assert sensors[1].current_distance == sensors[1].max_distance + 1  # no echo
    assert sensors[3].current_distance == 12
    assert sensors[7].current_distance == 900
    assert sensors[0].type == common.MAV_DISTANCE_SENSOR_ULTRASOUND


def test_a_sonar_tells_the_range_and_the_beam_of_the_robots_file(make_bench):
    sonar = SonarModelConfig(max_range_m=2.5, beam_deg=15.0)
    bench = make_bench(sonar=sonar)
    bench.run(0.3, sonar_m=(1.0, math.inf))
    heard, silent = bench.messages("DISTANCE_SENSOR")[:2]
    assert (heard.min_distance, heard.max_distance, heard.current_distance) == (0, 250, 100)
    assert (silent.max_distance, silent.current_distance) == (250, 251)
    assert heard.horizontal_fov == pytest.approx(math.radians(15.0))
    assert heard.vertical_fov == pytest.approx(math.radians(15.0))


def test_a_sonar_without_echo_is_told_whatever_range_the_file_gives_it(make_bench):
    bench = make_bench(sonar=SonarModelConfig(max_range_m=1e6))
    bench.run(0.3, sonar_m=(math.inf,))
    sensor = bench.messages("DISTANCE_SENSOR")[0]
    assert (sensor.max_distance, sensor.current_distance) == (0xFFFE, 0xFFFF)


def test_a_sonar_at_an_odd_angle_sends_its_quaternion(make_bench):
    bench = make_bench(sonars=(SonarMount("odd", 0.0, 0.0, -60.0),))
    bench.run(0.3, sonar_m=(1.0,), sonar_stamp_ns=(0,))
    sensor = bench.messages("DISTANCE_SENSOR")[0]
    assert sensor.orientation == common.MAV_SENSOR_ROTATION_CUSTOM
    assert sensor.quaternion == pytest.approx([math.sqrt(0.75), 0.0, 0.0, 0.5])
