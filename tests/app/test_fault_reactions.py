"""After each fault the wheels lose their power in time, whenever it strikes; in lockstep."""

import pytest

from hil_tests.fault_rows import ROWS
from reactions import Run, measure
from robotctl.app.config import find_file


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_wheels_lose_their_power_in_time(row):
    assert measure(find_file("diff_drive"), row, seed=101) <= row.limit_ms


@pytest.mark.parametrize("seed", [0, 2, 28])
def test_a_robot_whose_encoders_are_exchanged_is_stopped_before_it_runs_away(seed):
    # Each wheel makes the other faster: the turn rate doubles about each 40 ms.
    (row,) = (row for row in ROWS if row.name == "wheels_swapped")
    run = Run(find_file("diff_drive"), seed, row.omega_rad_s)
    run.drive(run.now_ns() + 1_000_000_000)
    assert run.reaction_ms(row, 0) < row.limit_ms
    assert not run.simulation.monitor.findings
