"""SLAM of simulated drives among landmarks, by odometry and camera that are off, and of MRCLAM."""

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.estimation.landmarks.models import sighting
from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.logs.formats.mrclam_log import read_mrclam
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.options import SlamOptions
from robotctl.workbench.slam.result import Estimated
from robotctl.workbench.slam.slam import slam_of_recording
from tests.estimation.landmarks.landmark_drives import simulated_drive


def made(recording, **options):
    options = SlamOptions(log=recording.name, **options)
    return slam_of_recording(recording, options, lambda *_: None).report()


@pytest.mark.parametrize("seed", range(2))
def test_the_camera_of_many_points_is_that_of_one(seed):
    rng = np.random.default_rng(seed)
    x = 0.1 * rng.standard_normal(18)
    points = rng.uniform(1.0, 4.0, (5, 2))
    expected, by_robot, by_point = CAMERA_POINT.expected(x, points)
    for k, point in enumerate(points):
        z, H, _ = sighting(x, tuple(point))
        assert expected[k] == pytest.approx(z)
        assert by_robot[k] == pytest.approx(H)
        assert by_point[k] == pytest.approx(-H[:, :2])
    z = expected[2]
    assert CAMERA_POINT.initial(x, z) == pytest.approx(points[2])


@pytest.mark.parametrize("association", ["names", "joint", "nearest"])
def test_a_drive_and_its_map_are_found_with_and_without_names(association):
    report = made(simulated_drive(1, seconds=80.0), association=association)
    assert report["landmarks"] == 8
    assert report["trajectory"]["rmse_m"] < 0.15
    assert report["trajectory"]["nees_inside_95"] > 0.8
    assert report["online"]["nees_inside_95"] > 0.8


def test_without_a_reference_at_its_time_nothing_is_compared():
    stamps = np.array([0, 1, 2])
    poses = np.zeros((3, 3))
    estimated = Estimated(Trajectory(stamps, poses))
    assert estimated.compared(None) is None
    assert estimated.compared(Trajectory(stamps + 10, poses)) is None
    assert estimated.compared(Trajectory(stamps, poses))["rmse_m"] == 0.0


@pytest.mark.parametrize("option", ["features", "solver", "association"])
def test_an_unknown_word_is_refused_with_those_that_are_allowed(option):
    with pytest.raises(ConfigError, match=f"--{option} ekff: unknown; allowed are"):
        SlamOptions(log="x", **{option: "ekff"})


@pytest.mark.recordings("mrclam/MRCLAM_Dataset7")
def test_a_real_robot_is_followed_and_the_doubt_is_right(recordings):
    report = made(read_mrclam(recordings / "mrclam" / "MRCLAM_Dataset7", 2))
    assert report["trajectory"]["rmse_m"] < 0.15
    assert report["trajectory"]["nees_inside_95"] > 0.9
    assert report["landmark_rmse_m"] < 0.25
