"""The kinematics of docs/extending.md drives in the simulator, sideways too, and is calibrated."""

import re

import numpy as np
import pytest
from robotctl.model.drives.h_drive import HDrive

from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.messages.control import Arm, SafetyState, VelocityCommand
from robotctl.model.geometry.twist import Twist
from robotctl.safety.state_machine import POWERED

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


def test_it_drives_ahead_and_sideways_in_the_simulator(robot):
    assert load_robot(robot).drive == DRIVE
    options = StackOptions("lockstep", str(robot), x_m=6.0, y_m=5.0, epoch_ns=0)
    simulation = make_simulation(robot, find_file("hall", "worlds"), 1, (6.0, 5.0, 0.0), ())
    stack = LockstepStack(options.load(), options, simulation)
    while stack.clock.now_ns() < 20e9 and simulation.truth().y_m < 5.5:
        now_ns, state = stack.clock.now_ns() + stack.period_ns, stack.core.machine.state
        wish = VelocityCommand(now_ns, now_ns + 200_000_000, 0.2, 0.0, 0.3)
        arm = Arm(now_ns, stack.ticks, arm=True)
        stack.tick((wish,) if state in POWERED else (arm,) * (state is SafetyState.STANDBY))
    state = stack.snapshot()
    truth = simulation.truth()
    assert truth.y_m > 5.49
    assert truth.x_m - 6.0 == pytest.approx(0.5 * 0.2 / 0.3, abs=0.06)
    assert (state.x_m, state.y_m) == pytest.approx((truth.x_m, truth.y_m), abs=0.05)
