"""What `robotctl doctor --bench` measures, and what it makes of it."""

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from robotctl.deploy.check_result import Verdict
from robotctl.deploy.doctor_bench import (
    capacity,
    check_control,
    check_costs,
    check_lag,
    check_navigation,
)
from robotctl.deploy.process_costs import CostMeter
from robotctl.deploy.rehearsal import Rehearsal, busy
from robotctl.messages.control import StepBudget
from tests.cli.command import status_of

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def rehearsal(
    lag_us=50.0, tick_us=200.0, publish_us=50.0, missed=0, step_ms=10.0, costs=None
) -> Rehearsal:
    ones = np.ones(10_000)
    steps = step_ms * np.ones(500)
    budget = StepBudget(
        parts_p50_ms={"plan": 0.1, "steer": 7.0}, parts_p99_ms={"plan": 9.0, "steer": 8.0}
    )
    return Rehearsal(
        200.0, 20.0, lag_us * ones, tick_us * ones, publish_us, missed, steps, budget, costs or {}
    )


def test_half_of_the_period_is_left_at_the_highest_rate_of_control() -> None:
    found = rehearsal(lag_us=150.0, tick_us=300.0, publish_us=50.0)
    assert found.control_hz == pytest.approx(1000.0)  # 0.5 ms of work in 1 ms


def test_a_fifth_of_the_period_is_left_at_the_highest_rate_of_navigation() -> None:
    assert rehearsal(step_ms=40.0).navigating_hz == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("missed", "verdict"), [(0, Verdict.OK), (10, Verdict.WARN), (11, Verdict.FAIL)]
)
def test_one_deadline_in_a_thousand_may_be_missed(missed: int, verdict: Verdict) -> None:
    assert check_control("", rehearsal(missed=missed)).verdict is verdict


def test_lags_are_counted_up_to_the_bound_that_holds_all_of_them() -> None:
    found = rehearsal()
    found.lag_us[:2500] = 70.0
    finding = check_lag("", found)
    assert finding.verdict is Verdict.OK
    assert finding.found.endswith("; within 50 us 75.00%, 100 us 100.00%")
    assert check_lag("", rehearsal(lag_us=501.0)).verdict is Verdict.WARN
    assert check_lag("", rehearsal(lag_us=6000.0)).found.count("within 5000 us none") == 1


def test_navigation_that_does_not_keep_its_rate_is_told_one_that_it_would_keep() -> None:
    assert check_navigation("", rehearsal(step_ms=49.0)).verdict is Verdict.OK
    finding = check_navigation("", rehearsal(step_ms=80.0))
    assert "; steer 7.0 (8.0), plan 0.1 (9.0)" in finding.found
    assert finding.verdict is Verdict.WARN
    assert finding.fix.startswith("navigation.rate_hz = 10,")


def test_a_computer_that_lets_navigation_do_no_step_is_told_so() -> None:
    found = dataclasses.replace(rehearsal(), step_ms=np.empty(0), budget=StepBudget())
    finding = check_navigation("", found)
    assert finding.verdict is Verdict.FAIL
    assert finding.found.startswith("no step was done")
    assert capacity("", found).found.endswith("navigation up to 0 Hz")


def test_a_computer_that_cannot_carry_the_rate_is_told_the_rate_that_it_can() -> None:
    assert capacity("", rehearsal()).verdict is Verdict.OK
    finding = capacity("", rehearsal(tick_us=4700.0))
    assert finding.verdict is Verdict.WARN
    assert finding.fix == "runtime.rate_hz = 104 at most"


def test_a_computer_too_slow_for_the_least_rate_is_not_told_a_rate_that_is_refused() -> None:
    finding = capacity("", rehearsal(tick_us=9000.0))
    assert finding.verdict is Verdict.WARN
    assert "runtime.rate_hz" not in finding.fix
    assert "the lowest is 100 Hz" in finding.fix


def process(proc: Path, pid: int, parent: int, words: str, used_s: float, mib: float) -> None:
    """Write what the kernel would say of a process; see proc_pid_stat(5)."""
    folder = proc / str(pid)
    folder.mkdir(exist_ok=True)
    ticks = round(used_s * TICKS_PER_S)
    (folder / "stat").write_text(f"{pid} (a (b) c) S {parent} {'0 ' * 9}{ticks - 1} 1 0 0 20")
    (folder / "cmdline").write_bytes(words.replace(" ", "\0").encode())
    (folder / "smaps_rollup").write_text(
        f"1-2 [rollup]\nRss: 9 kB\nPss:   {round(mib * 1024)} kB\nPss_Dirty: 7 kB\n"
    )


def test_costs_are_those_of_the_process_and_of_all_below_it(tmp_path: Path) -> None:
    meter = CostMeter(10, tmp_path)
    control = "python -m robotctl.app.processes.control {}"
    for time_s in range(11):
        process(tmp_path, 1, 0, "init", time_s, 500.0)
        process(tmp_path, 10, 1, "python -m robotctl sim", 0.02 * time_s, 30.0)
        process(tmp_path, 13, 10, "python -m firmware_sim", 0.3 * time_s, 20.0)
        process(tmp_path, 11, 10, control, max(0.0, 0.5 * (time_s - 4)) + 1.0, 40.0 - time_s)
        process(tmp_path, 12, 1, control, 9.0 * time_s, 70.0)  # another robot's
        meter.look(100.0 + time_s)
    costs = meter.costs(5.0)
    assert costs.keys() == {"simulator", "control"}
    assert costs["control"].cores == pytest.approx(0.5)
    assert costs["control"].mib == 40.0
    assert costs["simulator"].cores == pytest.approx(0.32)
    assert costs["simulator"].mib == 50.0
    finding = check_costs("", rehearsal(costs=costs), cores=1)
    assert finding.found.startswith("0.50 of 1 cores, 40 MiB: control 50%, 40 MiB; the simulation")
    assert check_costs("", rehearsal(costs={"a": costs["control"]} | costs), 1).verdict is (
        Verdict.WARN
    )


def test_busy_programs_take_the_processor_while_they_are_asked_for() -> None:
    before, end_s = os.times().children_user, time.process_time() + 0.3
    with busy(1):
        while time.process_time() < end_s:
            pass
    assert os.times().children_user - before > 0.05


def test_a_folder_whose_disk_no_bench_tests_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("doctor", "--bench", "--logs", str(tmp_path)) == 2
    assert "--logs: has no effect with --bench" in capsys.readouterr().err


def test_the_bench_drives_the_robot_and_says_what_the_computer_carries() -> None:
    with tempfile.TemporaryDirectory(prefix="bench") as alone:  # without the robots of other tests
        done = subprocess.run(
            [
                *(sys.executable, "-m", "robotctl", "doctor", "--robot", "diff_drive"),
                *("--bench", "--seconds", "4", "--json"),
            ],
            capture_output=True,
            check=False,
            env=os.environ | {"XDG_RUNTIME_DIR": alone},
        )
    report = json.loads(done.stdout)
    checks = [each["check"] for each in report["findings"]]
    kinds = ("control", "lag", "navigation", "processes", "carries")
    cores = os.cpu_count()
    phases = ("at rest", f"beside {cores} busy")
    assert checks == [f"{kind}, {phase}" for phase in phases for kind in kinds], done.stdout
    assert done.returncode == (0 if report["fit"] else 1)
    processes = report["findings"][3]["found"]
    assert all(f"{name} " in processes for name in ("control", "navigation", "telemetry"))
