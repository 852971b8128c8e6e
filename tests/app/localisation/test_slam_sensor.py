"""SLAM takes the best sensor that the robot has, or says what it needs."""

import msgspec
import numpy as np
import pytest

from robotctl.app.localisation.localiser import LocaliserInput, sensed_robot
from robotctl.app.localisation.slam_localiser import SlamLocaliser
from robotctl.app.localisation.slam_sensor import slam_sensor
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from tests.estimation.slam.keyframes.test_slam_mapper import OFFICE
from tests.estimation.slam.lidar_world import along
from tests.estimation.slam.local_scans.test_sonar_scans import heard
from tests.mavlink.conftest import CONTROL

DRIVE = along([(1.0, 1.0), (13.0, 1.0), (13.0, 6.0)], step_m=0.05, turn_rad=0.05)


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


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
def test_when_the_odometry_begins_anew_the_robot_stays_where_it_is():
    """The control process starts again half way; the wheels are exact, so nothing else errs."""
    config = load_robot(find_file("diff_drive"), ('localisation.sensors=["sonar"]',))
    chosen, history = slam_sensor(config, sensed_robot(config)), OdometryHistory()
    localiser = SlamLocaliser(SlamMapper(chosen.config), chosen, DRIVE[0], history)
    readings = heard(OFFICE, DRIVE, np.random.default_rng(3))
    half = len(DRIVE) // 2
    for number, (pose, reading) in enumerate(zip(DRIVE, readings, strict=True)):
        if number == half:
            localiser.begin_odometry()
        odometry = DRIVE[0 if number < half else half].inverse() @ pose
        history.add(reading.stamp_ns, odometry, number // half)
        state = msgspec.structs.replace(
            CONTROL, stamp_ns=reading.stamp_ns, x_m=odometry.x_m, y_m=odometry.y_m,
            theta_rad=odometry.theta_rad,
        )  # fmt: skip
        found = localiser.step(state, LocaliserInput({"sonar": [reading]}), reading.stamp_ns)
        off = (found.T_world_odom @ odometry).inverse() @ pose
        assert np.hypot(off.x_m, off.y_m) < 0.3
    assert localiser.mapper.keyframes[-1].stamp_ns > readings[half].stamp_ns
