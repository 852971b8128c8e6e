"""What the three robots must reach: velocity step, and a square by odometry alone."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.workbench.tuning.track import ExperimentSetting, speed_step

ROBOTS = ("diff_drive", "tricycle", "ackermann")
STEP_M_S = 0.5
POWER_LOW, POWER_CRITICAL, DRIVE_UNDER_VOLTAGE = 0x2300, 0x2301, 0x2005


def step_response(robot, *settings, weak=False):
    """True speeds every 5 ms, from the tick of the command on."""
    path = find_file(robot)
    config = load_robot(path)
    stack = ExperimentSetting(path, settings).stack(config)
    if weak:
        # At 70 % of the voltage the monitors would rightly refuse to drive.
        simulation = stack.simulation
        simulation.power.dictionary.set(POWER_LOW, 0, 6000)
        simulation.power.dictionary.set(POWER_CRITICAL, 0, 6000)
        simulation.drive.dictionary.set(DRIVE_UNDER_VOLTAGE, 0, 6000)
    step = speed_step(stack, STEP_M_S, 2.0)
    assert step.time_s[1] - step.time_s[0] == pytest.approx(0.005)
    return step.time_s, step.true_m_s


def assert_good(time_s, speed_m_s):
    outside = np.flatnonzero(np.abs(speed_m_s - STEP_M_S) > 0.02 * STEP_M_S)
    settled_s = time_s[outside[-1] + 1]
    steady_m_s = speed_m_s[time_s > 1.5].mean()
    assert settled_s < 0.4
    assert speed_m_s.max() < 1.05 * STEP_M_S
    assert abs(steady_m_s - STEP_M_S) < 0.01 * STEP_M_S


@pytest.mark.parametrize("charge", [1.0, 0.7])
@pytest.mark.parametrize("robot", ROBOTS)
def test_half_a_metre_per_second_is_there_in_time_at_full_and_at_used_battery(robot, charge):
    assert_good(*step_response(robot, f"simulation.battery.charge={charge}"))


@pytest.mark.parametrize("robot", ROBOTS)
def test_even_at_70_percent_of_the_voltage_the_speed_is_there_in_time(robot):
    assert_good(*step_response(robot, "simulation.battery.voltage_scale=0.7", weak=True))


@pytest.mark.parametrize(
    "setting",
    [
        "simulation.motor.coulomb_n_m=0.008",
        "simulation.motor.coulomb_n_m=0.0015",
        "simulation.wheels.rolling_resistance=0.05",
    ],
)
@pytest.mark.parametrize("robot", ROBOTS)
def test_other_friction_than_the_feedforward_expects_does_no_harm(robot, setting):
    assert_good(*step_response(robot, setting))


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_with_30_percent_more_load_still_overshoots_little_and_settles(robot):
    mass_kg = 1.3 * load_robot(find_file(robot)).simulation["mass_kg"]
    time_s, speed_m_s = step_response(robot, f"simulation.mass_kg={mass_kg}")
    assert speed_m_s.max() < 1.05 * STEP_M_S
    assert np.all(np.abs(speed_m_s[time_s > 0.6] - STEP_M_S) < 0.02 * STEP_M_S)


SHAPES = {
    "four sides of 2 m": [(2.0, 1.0), (4.0, 1.0), (4.0, 3.0), (2.0, 3.0), (2.0, 1.0)],
    "4 m by 2 m": [(1.0, 1.0), (5.0, 1.0), (5.0, 3.0), (1.0, 3.0), (1.0, 1.0)],
}
RADIUS_M = 0.6


def drive_round(folder: Path, robot, shape, seed, *settings):
    """Return how far from its start the robot really ends, and how far it went [m]."""
    corners = SHAPES[shape]
    x_m, y_m = corners[0]
    mission = folder / "square.toml"
    mission.write_text(
        f"""
        name = "square"
        world = "empty_room"
        start = {{ x_m = {x_m}, y_m = {y_m} }}
        [[item]]
        kind = "drive"
        waypoints = {[list(corner) for corner in corners]}
        corner_radius_m = {RADIUS_M}
        speed_m_s = 0.5
        """
    )
    run = LockstepRun(SimOptions(find_file(robot), mission, seed=seed, overrides=settings))
    report = run.run()
    assert report.mission_completed, report.message
    assert report.collisions == 0
    truth = run.stack.simulation.truth()
    return math.hypot(truth.x_m - x_m, truth.y_m - y_m), truth.distance_m


@pytest.mark.parametrize(("seed", "shape"), list(enumerate(SHAPES, 1)))
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_square_by_odometry_alone_closes_within_2_percent(tmp_path, robot, shape, seed):
    gap_m, length_m = drive_round(tmp_path, robot, shape, seed)
    sides_m = sum(math.dist(a, b) for a, b in itertools.pairwise(SHAPES[shape]))
    assert length_m == pytest.approx(sides_m - 3 * (2.0 - math.pi / 2) * RADIUS_M, abs=0.2)
    assert gap_m < 0.02 * length_m


def test_the_square_of_a_robot_that_is_not_calibrated_stays_open(tmp_path):
    gap_m, length_m = drive_round(
        tmp_path, "diff_drive", "4 m by 2 m", 1, "simulation.errors.wheel_radius=[0.0, 0.006]"
    )
    assert gap_m > 0.02 * length_m
