"""SLAM takes the best sensor that the robot has, or says what it needs."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from robotctl.app.localisation.localiser import LocaliserInput, sensed_robot
from robotctl.app.localisation.slam_files import KeyframeFile
from robotctl.app.localisation.slam_localiser import SlamLocaliser
from robotctl.app.localisation.slam_sensor import slam_sensor
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import from_upper_triangle
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along
from tests.estimation.slam.local_scans.test_sonar import heard
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


def test_only_a_lidar_finds_a_robot_on_a_map_that_stays_as_it_is():
    by_sonar = 'localisation.method="slam"', 'localisation.sensors=["sonar"]'
    kept = 'localisation.keyframes="office.keyframes"'
    assert sensor("diff_drive", *by_sonar, kept, "localisation.mapping=true").name == "sonar"
    with pytest.raises(ConfigError, match=r"'office.keyframes': only a lidar .*method = \"mcl\""):
        sensor("diff_drive", *by_sonar, kept)


def test_stretches_lie_along_the_odometry_of_the_robots_file():
    noise = ("odometry.e_m_per_sqrt_m=0.02", "odometry.f_rad_per_sqrt_m=0.003")
    wheels = sensor("diff_drive", 'localisation.sensors=["sonar"]', *noise).config.wheels
    assert wheels.sigma_m(0.25, 0.0) == pytest.approx(0.01)
    assert wheels.sigma_rad(4.0, 0.0) == pytest.approx(0.006)


def test_the_pose_is_less_sure_the_longer_the_way_since_the_last_scan_is():
    """By the law of white noise: after d metres e^2 d along, f^2 d^3 / 3 across, f^2 d in turn."""
    chosen, history = sensor("diff_drive", 'localisation.sensors=["sonar"]'), OdometryHistory()
    mapper = SlamMapper(replace(chosen.config, is_live=True))
    localiser = SlamLocaliser(mapper, chosen, SE2(1.0, 2.0, math.pi / 2.0), history)
    localiser.begin_odometry()
    for stamp_ns, x_m in enumerate((0.0, 0.5, 1.5), start=1):
        state = msgspec.structs.replace(CONTROL, stamp_ns=stamp_ns, x_m=x_m, y_m=0.0, theta_rad=0.0)
        found = localiser.step(state, LocaliserInput(), stamp_ns)
    covariance = from_upper_triangle(found.covariance)
    assert covariance[1, 1] == pytest.approx(0.01**2 * 1.5, rel=0.02)
    assert covariance[0, 0] == pytest.approx(0.01**2 * 1.5**3 / 3.0, rel=0.03)
    assert covariance[2, 2] == pytest.approx(0.01**2 * 1.5, rel=0.02)


def follow(localiser, history, steps, epoch_ns):
    """Drive by exact wheels from the first of some poses; return the farthest it was off [m]."""
    farthest_m = 0.0
    for (pose, reading), begin in steps:
        odometry = begin.inverse() @ pose
        history.add(reading.stamp_ns, odometry, epoch_ns)
        state = msgspec.structs.replace(
            CONTROL, stamp_ns=reading.stamp_ns, x_m=odometry.x_m, y_m=odometry.y_m,
            theta_rad=odometry.theta_rad, odom_epoch_ns=epoch_ns,
        )  # fmt: skip
        found = localiser.step(state, LocaliserInput({"sonar": [reading]}), reading.stamp_ns)
        off = (found.T_world_odom @ odometry).inverse() @ pose
        assert found.status is LocalisationStatus.LOCALISED
        farthest_m = max(farthest_m, float(np.hypot(off.x_m, off.y_m)))
    return farthest_m


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
@pytest.mark.parametrize("restarted", ["control", "navigation", "both"])
def test_a_robot_with_sonars_stays_where_it_is_when_a_process_begins_anew(restarted, tmp_path):
    """Half way; the wheels are exact and nobody pushes the robot, so nothing else errs."""
    config = load_robot(find_file("diff_drive"), ('localisation.sensors=["sonar"]',))
    chosen, history = slam_sensor(config, sensed_robot(config)), OdometryHistory()
    file = KeyframeFile(tmp_path / "office.keyframes", "sonar")
    localiser = SlamLocaliser(
        SlamMapper(replace(chosen.config, is_live=True)), chosen, DRIVE[0], history, file=file
    )
    steps = list(zip(DRIVE, heard(OFFICE, DRIVE, np.random.default_rng(3)), strict=True))
    half = len(DRIVE) // 2
    localiser.begin_odometry()
    assert follow(localiser, history, [(each, DRIVE[0]) for each in steps[:half]], 5) < 0.3
    before = len(localiser.mapper.keyframes)
    if restarted != "control":
        file.close()
        file = KeyframeFile(tmp_path / "office.keyframes", "sonar")
        assert "taken to be where it was last" in file.take_notices()[0]
        mapper, history = SlamMapper(replace(chosen.config, is_live=True)), OdometryHistory()
        localiser = SlamLocaliser(mapper, chosen, SE2(), history, file.saved, file)
        assert len(mapper.keyframes) == before
    localiser.begin_odometry()
    begin, epoch_ns = (DRIVE[0], 5) if restarted == "navigation" else (DRIVE[half], 6)
    # At 1 m/s a place that was saved half a second ago is half a metre away.
    farthest_m = 0.8 if restarted == "both" else 0.3
    rest = [(each, begin) for each in steps[half:]]
    assert follow(localiser, history, rest, epoch_ns) < farthest_m
    file.close()
    assert len(localiser.mapper.keyframes) > before
    link = next(each for each in localiser.mapper.back_end.links if each.second == before)
    sigma_m = np.sqrt(np.linalg.inv(link.information)[0, 0])
    assert (sigma_m > 0.5) == (restarted != "navigation")
