"""The simulated robot knows no map, makes one, and drives by it."""

import pytest

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
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


CORRIDOR = """
name = "corridor"
world = "corridor_loop"
start = { x_m = 2.0, y_m = 1.0, heading_deg = 0.0 }
[[item]]
kind = "drive"
waypoints = [[2.0, 1.0], [11.0, 1.0], [11.0, 7.0], [4.0, 7.0]]
corner_radius_m = 0.5
"""


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
def test_slam_by_sonars_alone_holds_the_heading_that_wrong_wheels_lose(tmp_path):
    mission = tmp_path / "corridor.toml"
    mission.write_text(CORRIDOR)
    settings = (*SLAM, 'localisation.sensors=["sonar"]')
    wrong = ("simulation.errors.wheel_radius=[0.002, -0.002]",)
    options = SimOptions(
        find_file("diff_drive"), mission, localisation=settings, overrides=wrong, max_seconds=50
    )
    report = run_lockstep(options)
    place = report.localisation
    assert report.collisions == 0
    assert place.localised_share == 1.0
    assert place.error.rmse_m < 0.5 * place.odometry_rmse_m
