"""What `make test` runs and what it says at the end."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

PATH = Path(__file__).resolve().parents[2] / "tools" / "run_tests.py"
spec = importlib.util.spec_from_file_location("run_tests", PATH)
assert spec is not None
assert spec.loader is not None
run_tests = importlib.util.module_from_spec(spec)
sys.modules["run_tests"] = run_tests
spec.loader.exec_module(run_tests)
Outcome, PASSED, FAILED = run_tests.Outcome, run_tests.PASSED, run_tests.FAILED


def stages(monkeypatch: pytest.MonkeyPatch, here: bool, fails: str = "") -> list[tuple[str, str]]:
    """Return (name, result) of the vcan stages on a machine; the one named `fails` fails."""
    monkeypatch.setattr(run_tests, "vcan_here", lambda: here)

    def run(name: str, *_commands: tuple[str, ...]) -> object:
        return Outcome(name, FAILED if fails and fails in name else PASSED)

    return [(outcome.name, outcome.result) for outcome in run_tests.late_stages("", run)]


def test_a_kernel_with_vcan_needs_no_guest(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stages(monkeypatch, here=True)[1:] == [("HIL on vcan, this kernel, real time", PASSED)]


def test_without_vcan_all_runs_in_virtual_time_and_a_smoke_in_real_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = [name for name, _ in stages(monkeypatch, here=False)]
    assert names[-2:] == [
        "HIL on vcan, two guests, virtual time",
        "smoke on vcan, guest, real time",
    ]


def test_a_failing_stage_does_not_keep_the_next_from_running(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    results = stages(monkeypatch, here=False, fails="virtual time")
    assert [result for _, result in results] == [PASSED, PASSED, PASSED, FAILED, PASSED]


def test_without_vcan_and_guest_the_run_fails_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    results = stages(monkeypatch, here=False, fails="kernel and boot")
    assert results[-1] == ("HIL on vcan", run_tests.NOT_RUN)
    outcomes = [Outcome(name, result) for name, result in results]
    assert run_tests.verdict(outcomes, "")[1] == 1


def passed(name: str, *_commands: tuple[str, ...]) -> object:
    return Outcome(name, PASSED)


@pytest.mark.parametrize("wanted", ["", "off"])
@pytest.mark.parametrize("here", [True, False])
@pytest.mark.parametrize("fails", ["", "kernel and boot"])
def test_missions_run_once_and_beside_nothing(
    monkeypatch: pytest.MonkeyPatch, wanted: str, here: bool, fails: str
) -> None:
    monkeypatch.setattr(run_tests, "vcan_here", lambda: here)
    beside: list[tuple[str, ...]] = []
    times = 0

    def run(name: str, *commands: tuple[str, ...]) -> object:
        nonlocal times
        missions = run_tests.missions(wanted)
        if missions in commands:
            times += 1
            beside.extend(each for each in commands if each != missions)
        return Outcome(name, FAILED if fails and fails in name else PASSED)

    run_tests.late_stages(wanted, run)
    assert times == 1
    assert not beside


def test_vcan_left_out_on_demand_passes_and_says_so() -> None:
    outcomes = run_tests.late_stages("off", passed)
    line, status = run_tests.verdict([Outcome("unit tests", PASSED), *outcomes], "off")
    assert status == 0
    assert "without real vcan (VCAN=off)" in line


def test_a_failed_test_fails_the_run_with_vcan_left_out_too() -> None:
    outcomes = [Outcome("unit tests", FAILED), *run_tests.late_stages("off", passed)]
    assert run_tests.verdict(outcomes, "off") == ("make test: FAILED", 1)


def test_the_status_of_a_stage_is_its_commands(capfd: pytest.CaptureFixture[str]) -> None:
    bad = run_tests.stage("bad", (sys.executable, "-c", "print('seen'); raise SystemExit(5)"))
    good = run_tests.stage("good", (sys.executable, "-c", ""))
    assert (bad.result, bad.note) == (FAILED, "exit 5: seen")
    assert good.result == PASSED
    assert "seen" in capfd.readouterr().out


def test_the_summary_names_the_tests_that_failed_or_were_run_again(
    capfd: pytest.CaptureFixture[str],
) -> None:
    told = ("FAILED hil_tests/test_a.py::test_b - too late", "RUN AGAIN test_c: it stood")
    print_both = f"print('....'); print({told[0]!r}); print('=== end'); raise SystemExit(1)"
    outcome = run_tests.stage(
        "both", (sys.executable, "-c", print_both), (sys.executable, "-c", f"print({told[1]!r})")
    )
    assert outcome.tests == told
    assert outcome.lines().splitlines()[1:] == [f"    {line}" for line in told]
    assert "=== end" in capfd.readouterr().out


def test_tests_that_did_not_run_are_named_and_counted(capfd: pytest.CaptureFixture[str]) -> None:
    told = [f"not run, recordings missing: /nowhere: test_a.py::test_{name}" for name in "bc"]
    lines = "\n".join(("..ss", *told, "2 passed, 2 skipped"))
    outcome = run_tests.stage("some", (sys.executable, "-c", f"print({lines!r})"))
    assert outcome.result == PASSED
    first, *named = outcome.lines().splitlines()
    assert first.endswith("2 tests not run")
    assert [line.strip() for line in named] == told
    assert "2 skipped" in capfd.readouterr().out


def test_a_stage_of_which_all_tests_ran_says_nothing_of_it() -> None:
    assert run_tests.stage("all", (sys.executable, "-c", "")).lines().endswith(" s")


def test_a_command_that_leaves_a_process_behind_ends_its_stage() -> None:
    leave = (
        "import subprocess, sys\n"
        "child = subprocess.Popen((sys.executable, '-c', 'input()'), stdin=subprocess.PIPE)\n"
        "print(child.pid); import os; os._exit(0)"
    )
    assert run_tests.stage("left", (sys.executable, "-c", leave)).result == PASSED


def test_commands_of_a_stage_run_side_by_side_and_each_must_pass(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    # Each waits for the other's file: one after the other they would never end.
    meet = (
        "import pathlib, sys, time\n"
        "mine, other = map(pathlib.Path, sys.argv[1:3])\n"
        "mine.touch()\n"
        "while not other.exists(): time.sleep(0.01)\n"
        "print('met at', mine.name); sys.exit(int(sys.argv[3]))"
    )
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    both = run_tests.stage(
        "both", (sys.executable, "-c", meet, a, b, "0"), (sys.executable, "-c", meet, b, a, "3")
    )
    assert (both.result, both.note) == (FAILED, "exit 3: met at b")
    seen = capfd.readouterr().out
    assert "met at a" in seen
    assert "met at b" in seen


def test_no_hil_test_is_left_out_of_the_guests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_tests, "vcan_here", lambda: False)
    commands: list[tuple[str, ...]] = []

    def run(name: str, *given: tuple[str, ...]) -> object:
        commands.extend(given)
        return Outcome(name, PASSED)

    run_tests.late_stages("on", run)
    commands = [command for command in commands if "simcan" not in command]
    given = {argument for command in commands for argument in command}
    files = {str(p.relative_to(run_tests.ROOT)) for p in run_tests.ROOT.glob("hil_tests/test_*")}
    assert files <= given


def test_what_simcan_leaves_to_vcan_runs_on_simcan_without_that() -> None:
    for_all = {*run_tests.on_simcan("off"), *run_tests.missions("off")}
    assert set(run_tests.HIL) <= for_all
    assert not any("deselect" in each for each in for_all)
    shorter = {*run_tests.on_simcan(""), *run_tests.missions("")}
    assert set(run_tests.HIL) - shorter == {run_tests.FAULT_ROWS}
    assert {each for each in shorter if "deselect" in each} == {
        f"--deselect={each}" for each in run_tests.PATROLS
    }
