"""The compass of docs/extending.md turns particles and the EKF to where north is."""

import math
from pathlib import Path

import pytest

from robotctl.app.localisation.estimators import make_estimators
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.messages.estimation import Heading
from robotctl.model.geometry.se2 import SE2
from tests.app.localisation.test_estimators import control

ROBOT = find_file("diff_drive")
STEP_NS = 50_000_000


def heading_after(method, *sensors, true_rad=0.1):
    """Return the heading found [rad]: the odometry says 0, the compass something else."""
    named = ", ".join(f'"{each}"' for each in sensors)
    settings = (
        f'localisation.method="{method}"',
        'localisation.map="flat"',
        f"localisation.sensors=[{named}]",
    )
    several = make_estimators(load_robot(ROBOT, settings), SE2(1.0, 1.0), Path())
    for step in range(40):
        now_ns = step * STEP_NS
        place = SE2(1.0 + 0.02 * step, 1.0)
        state = control(now_ns, place)
        found = several.step(state, [Heading(now_ns, true_rad)], (), now_ns)
    return (found.T_world_odom @ place).theta_rad


@pytest.mark.parametrize("method", ["mcl", "ekf"])
def test_the_heading_follows_the_compass(method):
    assert heading_after(method, "compass") == pytest.approx(0.1, abs=0.03)


def test_particles_listen_only_to_the_sensors_that_the_file_names():
    assert math.isclose(heading_after("mcl", "sonar"), 0.0, abs_tol=0.03)


def test_the_file_may_name_each_sensor_of_the_registry_and_no_other():
    with pytest.raises(ConfigError, match="compass"):
        heading_after("mcl", "compas")
