"""After each fault the wheels lose their power in time, whenever it strikes; in lockstep."""

import pytest

from hil_tests.fault_rows import ROWS
from reactions import Run, can_feel, measure
from robotctl.app.simulation.simulator_files import simulated_robot
from robotctl.config.robot_file import find_file

ROBOTS = ("diff_drive", "tricycle", "ackermann")
FELT = [
    pytest.param(robot, row, id=f"{robot}-{row.name}")
    for robot in ROBOTS
    for row in ROWS
    if can_feel(simulated_robot(find_file(robot)), row)
]


@pytest.mark.parametrize(("robot", "row"), FELT)
def test_the_wheels_lose_their_power_in_time(robot, row):
    assert measure(find_file(robot), row, seed=101) <= row.limit_ms


@pytest.mark.parametrize("robot", ROBOTS)
def test_only_a_robot_with_two_motors_feels_the_second_and_their_exchange(robot):
    simulated = simulated_robot(find_file(robot))
    missing = {row.name for row in ROWS if not can_feel(simulated, row)}
    one_motor = {"encoder_stuck wheel=right", "wheels_swapped"}
    assert missing == (set() if robot == "diff_drive" else one_motor)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_host_says_what_the_fault_can_explain(row):
    run = Run(find_file("diff_drive"), 7, row.omega_rad_s)
    run.drive(run.now_ns() + 1_000_000_000)
    run.reaction_ms(row, 0)
    code, part = run.fault()
    assert row.explains(code, part), (code.name, part)


@pytest.mark.parametrize("seed", [0, 2, 28])
def test_a_robot_whose_encoders_are_exchanged_is_stopped_before_it_runs_away(seed):
    # Each wheel makes the other faster: the turn rate doubles about each 40 ms.
    (row,) = (row for row in ROWS if row.name == "wheels_swapped")
    run = Run(find_file("diff_drive"), seed, row.omega_rad_s)
    run.drive(run.now_ns() + 1_000_000_000)
    assert run.reaction_ms(row, 0) < row.limit_ms
    assert not run.simulation.monitor.findings
