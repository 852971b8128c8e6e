"""What `make test` runs and what it says at the end."""

from __future__ import annotations

import importlib.util
import sys
import time
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


class Fake:
    """A stage that runs nothing."""

    def __init__(self, name: str, result: str, log: list[str]) -> None:
        self._name, self._result, self._log = name, result, log

    def outcome(self) -> object:
        self._log.append(f"end {self._name}")
        return Outcome(self._name, self._result)


class Runs:
    """What was begun and awaited of all stages; the one named `fails` fails."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        here: bool,
        fails: str = "",
        wanted: str = "",
        has_byte_code: bool = True,
    ) -> None:
        monkeypatch.setattr(run_tests, "vcan_here", lambda: here)
        monkeypatch.setattr(run_tests, "has_byte_code", lambda: has_byte_code)
        self.log: list[str] = []
        self.commands: dict[str, tuple[tuple[str, ...], ...]] = {}
        self.in_background: list[str] = []

        def begin(name: str, *commands: tuple[str, ...], in_background: bool = False) -> Fake:
            self.log.append(f"begin {name}")
            self.commands[name] = commands
            self.in_background += [name] if in_background else []
            return Fake(name, FAILED if fails and fails in name else PASSED, self.log)

        self.outcomes = run_tests.stages(wanted, begin)
        self.results = [(outcome.name, outcome.result) for outcome in self.outcomes]


def test_a_kernel_with_vcan_needs_no_guest(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = Runs(monkeypatch, here=True)
    assert runs.results[-1] == ("HIL on vcan, this kernel, real time", PASSED)
    assert not any("guest" in name for name, _ in runs.results)


def test_without_vcan_all_runs_in_virtual_time_and_a_smoke_in_real_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = [name for name, _ in Runs(monkeypatch, here=False).results]
    assert names[-2].startswith("smoke on vcan, guest, real time")
    assert names[-1].startswith("HIL on vcan, two guests, virtual time")


def test_what_is_compiled_first_is_compiled_at_once_and_awaited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = Runs(monkeypatch, here=False, has_byte_code=False).log
    names = ["kernels", "byte code of the tests", "vcan guest: kernel and boot"]
    assert log[:6] == [f"{what} {name}" for what in ("begin", "end") for name in names]
    assert "begin byte code of the tests" not in Runs(monkeypatch, here=False).log


def test_only_guests_in_virtual_time_run_beside_others(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = Runs(monkeypatch, here=False)
    (guests,) = runs.in_background
    assert "virtual time" in guests
    assert not any("--real-time" in command for command in runs.commands[guests])
    # They have the processors that the guest tool's own tests want.
    assert runs.log.index("end vcan guest: the tool's own tests") < runs.log.index(
        f"begin {guests}"
    )
    others = [line for line in runs.log[4:] if guests not in line]  # behind what is compiled first
    assert [line.split()[0] for line in others] == ["begin", "end"] * (len(others) // 2)


def test_a_failing_stage_does_not_keep_the_next_from_running(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    results = [result for _, result in Runs(monkeypatch, False, "unit tests").results]
    assert results == [PASSED, PASSED, PASSED, FAILED, *(4 * [PASSED])]


def test_without_vcan_and_guest_the_run_fails_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = Runs(monkeypatch, False, "kernel and boot")
    assert runs.results[-1] == ("HIL on vcan", run_tests.NOT_RUN)
    assert ("unit tests", PASSED) in runs.results
    assert run_tests.verdict(runs.outcomes, "")[1] == 1


@pytest.mark.parametrize("wanted", ["", "off"])
@pytest.mark.parametrize("here", [True, False])
@pytest.mark.parametrize("fails", ["", "kernel and boot"])
def test_missions_run_once_in_a_stage_of_their_own(
    monkeypatch: pytest.MonkeyPatch, wanted: str, here: bool, fails: str
) -> None:
    runs = Runs(monkeypatch, here, fails, wanted)
    missions = run_tests.missions(wanted)
    assert [commands for commands in runs.commands.values() if missions in commands] == [
        (missions,)
    ]


def test_vcan_left_out_on_demand_passes_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    line, status = run_tests.verdict(Runs(monkeypatch, False, wanted="off").outcomes, "off")
    assert status == 0
    assert "without real vcan (VCAN=off)" in line


def test_a_failed_test_fails_the_run_with_vcan_left_out_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outcomes = Runs(monkeypatch, False, "unit tests", wanted="off").outcomes
    assert run_tests.verdict(outcomes, "off") == ("make test: FAILED", 1)


def stage(name: str, *commands: tuple[str, ...], in_background: bool = False) -> object:
    return run_tests.Stage(name, *commands, in_background=in_background).outcome()


def test_what_runs_in_the_background_has_idle_time_until_it_is_awaited(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    wait = "while os.sched_getscheduler(0) != os.SCHED_{}: time.sleep(0.01)\n"
    # As a guest it has a session of its own, which stands back where the kernel has shares of them.
    child = (
        "import os, pathlib, time\n"
        "session = pathlib.Path('/proc/self/autogroup')\n"
        "if session.exists(): session.write_text('19')\n"
        f"{wait.format('IDLE')}pathlib.Path({str(begun)!r}).touch()\n{wait.format('OTHER')}"
        "while session.exists() and 'nice 0' not in session.read_text(): time.sleep(0.01)\n"
    )
    command = (
        "import os, subprocess, sys, time\n"
        "own = {'start_new_session': True}\n"
        f"{wait.format('IDLE')}"
        f"child = subprocess.Popen((sys.executable, '-c', {child!r}), **own)\n"
        f"{wait.format('OTHER')}raise SystemExit(child.wait())"
    )
    stage = run_tests.Stage("beside", (sys.executable, "-c", command), in_background=True)
    while not begun.exists():
        time.sleep(0.01)
    assert stage.outcome().result == PASSED


def test_the_status_of_a_stage_is_its_commands(capfd: pytest.CaptureFixture[str]) -> None:
    bad = stage("bad", (sys.executable, "-c", "print('seen'); raise SystemExit(5)"))
    good = stage("good", (sys.executable, "-c", ""))
    assert (bad.result, bad.note) == (FAILED, "exit 5: seen")
    assert good.result == PASSED
    assert "seen" in capfd.readouterr().out


def test_the_summary_names_the_tests_that_failed_or_were_run_again(
    capfd: pytest.CaptureFixture[str],
) -> None:
    told = ("FAILED hil_tests/test_a.py::test_b - too late", "RUN AGAIN test_c: it stood")
    print_both = f"print('....'); print({told[0]!r}); print('=== end'); raise SystemExit(1)"
    outcome = stage(
        "both", (sys.executable, "-c", print_both), (sys.executable, "-c", f"print({told[1]!r})")
    )
    assert outcome.tests == told
    assert outcome.lines().splitlines()[1:] == [f"    {line}" for line in told]
    assert "=== end" in capfd.readouterr().out


def test_tests_that_did_not_run_are_named_and_counted(capfd: pytest.CaptureFixture[str]) -> None:
    told = [f"not run, recordings missing: /nowhere: test_a.py::test_{name}" for name in "bc"]
    lines = "\n".join(("..ss", *told, "2 passed, 2 skipped"))
    outcome = stage("some", (sys.executable, "-c", f"print({lines!r})"))
    assert outcome.result == PASSED
    first, *named = outcome.lines().splitlines()
    assert first.endswith("2 tests not run")
    assert [line.strip() for line in named] == told
    assert "2 skipped" in capfd.readouterr().out


def test_a_stage_of_which_all_tests_ran_says_nothing_of_it() -> None:
    assert stage("all", (sys.executable, "-c", "")).lines().endswith(" s")


def test_a_command_that_leaves_a_process_behind_ends_its_stage() -> None:
    leave = (
        "import subprocess, sys\n"
        "child = subprocess.Popen((sys.executable, '-c', 'input()'), stdin=subprocess.PIPE)\n"
        "print(child.pid); import os; os._exit(0)"
    )
    assert stage("left", (sys.executable, "-c", leave)).result == PASSED


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
    both = stage(
        "both", (sys.executable, "-c", meet, a, b, "0"), (sys.executable, "-c", meet, b, a, "3")
    )
    assert (both.result, both.note) == (FAILED, "exit 3: met at b")
    seen = capfd.readouterr().out
    assert "met at a" in seen
    assert "met at b" in seen


def test_no_hil_test_is_left_out_of_the_guests(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = Runs(monkeypatch, here=False)
    (guests,) = runs.in_background
    given = [argument for command in runs.commands[guests] for argument in command]
    files = {str(p.relative_to(run_tests.ROOT)) for p in run_tests.ROOT.glob("hil_tests/test_*")}
    assert all(given.count(file) == 1 for file in files)


def test_what_simcan_leaves_to_vcan_runs_on_simcan_without_that() -> None:
    for_all = {*run_tests.on_simcan("off"), *run_tests.missions("off")}
    assert set(run_tests.HIL) <= for_all
    assert not any("deselect" in each for each in for_all)
    shorter = {*run_tests.on_simcan(""), *run_tests.missions("")}
    assert set(run_tests.HIL) - shorter == {run_tests.FAULT_ROWS}
    assert not {*run_tests.PATROLS} & {
        each.removeprefix("--deselect=") for each in run_tests.ON_VCAN
    }
    assert {each for each in shorter if "deselect" in each} == {
        f"--deselect={each}" for each in run_tests.PATROLS
    }
