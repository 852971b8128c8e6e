"""A run's time counts from arming; a report says which limit ended it, and what was missing."""

import io

import msgspec
import pytest
from rich.console import Console

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.time_limit import TimeLimit
from robotctl.cli.live.score_view import score_table
from robotctl.config.robot_file import find_file
from robotctl.messages.control import SafetyState

SECOND_NS = 1_000_000_000


class Control:
    def __init__(self, state):
        self.state = state


STANDBY, ARMED = Control(SafetyState.STANDBY), Control(SafetyState.ARMED)


def test_a_slow_start_takes_nothing_from_the_time_of_a_run():
    limit = TimeLimit(10.0)
    assert limit.step(None, 0, is_ready=False) == ""
    assert limit.step(STANDBY, 300 * SECOND_NS, is_ready=False) == ""
    assert limit.step(STANDBY, 305 * SECOND_NS, is_ready=True) == ""
    assert limit.step(ARMED, 307 * SECOND_NS, is_ready=True) == ""
    assert limit.step(STANDBY, 317 * SECOND_NS, is_ready=True) == ""  # disarmed since
    assert "10 s after arming" in limit.step(ARMED, 317 * SECOND_NS + 1, is_ready=True)


def test_a_robot_that_is_ready_and_never_armed_ends_too():
    limit = TimeLimit(10.0)
    assert limit.step(STANDBY, 100 * SECOND_NS, is_ready=True) == ""
    assert limit.step(STANDBY, 110 * SECOND_NS, is_ready=True) == ""
    assert "not armed within 10 s" in limit.step(STANDBY, 111 * SECOND_NS, is_ready=True)


def test_the_report_names_the_limit_and_what_the_robot_was_at():
    options = SimOptions(find_file("diff_drive"), find_file("patrol", "missions"), max_seconds=3.0)
    run = LockstepRun(options)
    armed_s = None
    for control, _ in run.steps():
        if armed_s is None and control.state is SafetyState.ARMED:
            armed_s = control.stamp_ns * 1e-9
    report = run._report(1.0)
    assert report.duration_s == pytest.approx(armed_s + 3.0, abs=0.1)
    assert "3 s after arming" in report.ended
    table = io.StringIO()
    Console(file=table, width=250).print(score_table(report))
    row = next(line for line in table.getvalue().splitlines() if "not completed" in line)
    assert report.ended in row
    assert report.message in row
    assert msgspec.json.decode(report.json())["ended"] == report.ended
