"""SLAM takes the best sensor that the robot has, or says what it needs."""

import pytest

from robotctl.app.localisation.localiser import sensed_robot
from robotctl.app.localisation.slam_sensor import slam_sensor
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError


def sensor(robot, *overrides):
    config = load_robot(find_file(robot), overrides)
    return slam_sensor(config, sensed_robot(config))


@pytest.mark.parametrize(
    ("overrides", "name"),
    [
        ((), "lidar"),
        (('localisation.sensors=["sonar"]',), "sonar"),
        (('localisation.sensors=["sonar", "lidar"]',), "lidar"),
    ],
)
def test_a_lidar_comes_first_unless_the_robots_file_leaves_it_out(overrides, name):
    assert sensor("diff_drive", *overrides).name == name


def test_a_robot_without_a_lidar_takes_its_sonars_and_one_without_these_its_camera():
    config = load_robot(find_file("diff_drive"), ("camera.enabled=true",))
    del config.simulation["lidar"]
    assert slam_sensor(config, sensed_robot(config)).name == "sonar"
    assert slam_sensor(config, sensed_robot(config)._replace(mounts=())).name == "camera"


def test_a_robot_that_has_no_such_sensor_hears_what_it_has():
    with pytest.raises(
        ConfigError, match=r"the robot has lidar, localisation.sensors allows sonar"
    ):
        sensor("jackal", 'localisation.sensors=["sonar"]')


def test_a_map_that_cannot_be_gone_on_with_is_not_kept():
    kept = 'localisation.keyframes="office.keyframes"'
    with pytest.raises(ConfigError, match=r"'office.keyframes': a map of keyframes needs a lidar"):
        sensor("diff_drive", 'localisation.method="slam"', 'localisation.sensors=["sonar"]', kept)
