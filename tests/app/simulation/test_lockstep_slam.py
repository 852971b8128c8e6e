"""The simulated robot knows no map, makes one by its lidar, and drives by it."""

import pytest

from tests.app.simulation.missions import drive

SLAM = ('localisation.method="slam"', "localisation.mapping=true")


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
def test_slam_corrects_what_wrong_wheels_make_of_the_odometry_and_draws_the_map():
    wrong = ("simulation.errors.wheel_radius=[0.01, -0.01]",)
    report = drive(localisation=SLAM, overrides=wrong, max_seconds=25)
    place = report.localisation
    assert report.collisions == 0
    assert place.error.max_m < 0.05
    assert place.error.rmse_m < 0.3 * place.odometry_rmse_m
    assert report.map_quality.precision > 0.97
