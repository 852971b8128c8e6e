"""The simulated robot knows no map, makes one, and drives by it."""

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


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
def test_slam_by_sonars_alone_holds_the_heading_that_wrong_wheels_lose():
    report = drive(
        localisation=(*SLAM, 'localisation.sensors=["sonar"]'),
        overrides=("simulation.errors.wheel_radius=[0.002, -0.002]",),
        max_seconds=35,
    )
    place = report.localisation
    assert report.collisions == 0
    assert place.localised_share == 1.0
    assert place.error.rmse_m < 0.6 * place.odometry_rmse_m
