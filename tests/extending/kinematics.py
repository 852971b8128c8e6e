"""The kinematics of docs/extending.md fits that of the simulator and is calibrated."""

import re

import numpy as np
import pytest
from robotctl.model.drives.h_drive import HDrive

from firmware_sim.config.config import load_robot as load_simulated
from firmware_sim.config.drives.chassis import Hold
from firmware_sim.plant.axis import Limits
from firmware_sim.plant.plant import Plant
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.model.geometry.twist import Twist
from tests.firmware_sim.plant.plants import FRICTIONLESS, OPEN, STIFF, run_wheels

DRIVE = HDrive("h_drive", 0.4, 0.2, 0.076, 8192)


@pytest.fixture
def robot(tmp_path):
    """Return a file like that of the mecanum robot, with three wheels."""
    text = find_file("mecanum").read_text(encoding="utf-8")
    text = text.replace('kind = "mecanum"', 'kind = "h_drive"')
    text = text.replace("wheelbase_m = 0.36", "rear_m = 0.2")
    text = text.replace("centre_of_mass_m = [-0.01, 0.0]", "centre_of_mass_m = [-0.06, 0.0]")
    text = re.sub(r"\[\[motor\]\]\n(?:(?!\n\n).)*rear_right.*?\n\n", "", text, flags=re.DOTALL)
    for before, after in (
        ("front_left", "left"), ("front_right", "right"), ("rear_left", "across"),
    ):  # fmt: skip
        text = text.replace(before, after)
    path = tmp_path / "h_drive.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_wheels_and_velocity_fit_each_other_and_many_rows_do_as_one():
    moves = np.array([[0.3, 0.2, -0.1], [-0.2, 0.0, 0.4]])
    rows = [DRIVE.inverse(Twist(*move)).wheels_rad_s for move in moves.tolist()]
    np.testing.assert_allclose(DRIVE.inverse_many(moves), rows)
    np.testing.assert_allclose(DRIVE.forward_many(np.array(rows)), moves, atol=1e-12)


def test_calibration_asks_it_for_its_keys():
    model = OdometryModel(DRIVE)
    assert model.keys == ("wheel_radius_m", "track_width_m")
    assert model.drive(np.log([1.01, 1.02])).track_width_m == pytest.approx(0.408)


def test_its_wheels_roll_where_the_simulators_stand_without_slipping(robot):
    simulated = load_simulated(robot)
    chassis = simulated.drive.chassis(simulated.simulation)
    assert simulated.drive.wheel_names == load_robot(robot).drive.wheel_names
    v, omega, vy = 0.3, 0.7, -0.2
    wheels_rad_s = DRIVE.inverse(Twist(v, omega, vy)).wheels_rad_s
    driven = [grip for grip in chassis.grips if grip.hold is not Hold.ROLLER]
    assert [grip.wheel for grip in driven] == [0, 1, 2]
    for grip, wheel, turns in zip(driven, chassis.wheels, wheels_rad_s, strict=True):
        floor_m_s = np.dot(grip.along, (v - omega * grip.y_m, vy + omega * grip.x_m))
        assert floor_m_s == pytest.approx(grip.roll * wheel.radius_m * turns)


def test_the_simulated_robot_moves_as_its_wheels_are_told(robot):
    p = Plant(load_simulated(robot, {**FRICTIONLESS, **STIFF}), OPEN, np.random.default_rng(1))
    wanted = Twist(0.3, 0.5, -0.2)
    run_wheels(
        p, *DRIVE.inverse(wanted).wheels_rad_s, limits=Limits(kp_a_s_rad=20.0, ki_a_rad=200.0)
    )
    p.step(1500)
    assert (p.v_m_s, p.omega_rad_s, p.vy_m_s) == pytest.approx(wanted, abs=5e-3)
