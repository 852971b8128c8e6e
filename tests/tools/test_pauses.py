"""Which failed HIL tests say nothing, and are run again: those in whose time the machine stood.

Never those in which the simulator's monitor saw an unsafe motion, nor those whose process died.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil_tests.pauses import LIMIT_MS, WINDOW_MS, Pauses, PauseWitness, covered_ns

ROOT = Path(__file__).resolve().parents[2]
PAUSING = """
import time
import pytest
from hil_tests.conftest import RERUN_LATER, WITNESS

RERUN_LATER["reruns_delay"] = 0  # this machine stands only when it is told so

class Told:
    "A witness of no pauses but those that it is told."
    paused_ns = 0

    def longest_ms(self, since_ns):
        return 100.0 if self.paused_ns > since_ns else 0.0

    def close(self):
        pass

@pytest.fixture(autouse=True, scope="session")
def nothing_else_counts(pytestconfig):
    pytestconfig.stash[WITNESS].close()
    pytestconfig.stash[WITNESS] = Told()

def pause(config):
    config.stash[WITNESS].paused_ns = time.monotonic_ns()
"""
TESTS = """
runs = []

def test_that_fails_for_the_pause(request):
    runs.append("paused")
    if runs.count("paused") == 1:
        pause(request.config)
        assert False

def test_that_fails_by_itself():
    runs.append("itself")
    assert False

def test_that_fails_with_and_without_a_pause(request):
    runs.append("both")
    if runs.count("both") == 1:
        pause(request.config)
    assert False

def test_how_often_they_ran():
    assert [runs.count(name) for name in ("paused", "itself", "both")] == [2, 1, 2]
"""
UNSAFE = """
import pytest
from hil_tests.rig import UnsafeMotionError

runs = []

@pytest.fixture
def unsafe():
    yield
    raise UnsafeMotionError("power without any command")

@pytest.fixture
def end_fails():
    yield
    raise OSError("a port that does not close")

@pytest.fixture
def hides(unsafe):
    yield
    try:
        raise UnsafeMotionError("power without any command")
    finally:
        raise KeyError("behind it")

@pytest.fixture(scope="module")
def shared():
    yield
    raise UnsafeMotionError("power without any command")

def test_that_sees_it(request):
    runs.append("sees")
    pause(request.config)
    raise UnsafeMotionError("power without any command")

def test_whose_bench_saw_it(request, unsafe):
    runs.append("bench")
    pause(request.config)

def test_that_fails_before_its_bench_says_so(request, unsafe):
    runs.append("before")
    pause(request.config)
    assert False

def test_with_two_ends_that_fail(request, end_fails, unsafe):
    runs.append("two")
    pause(request.config)
    assert False

def test_with_an_error_behind_it(request, hides):
    runs.append("hidden")
    pause(request.config)
    assert False

def test_how_often_they_ran():
    assert [runs.count(name) for name in ("sees", "bench", "before", "two", "hidden")] == [1] * 5

def test_whose_module_s_bench_saw_it(request, shared):
    pause(request.config)
"""
DEAD = """
import os, pathlib, signal
import pytest

DIED = pathlib.Path(__file__).with_name("died")

@pytest.mark.parametrize("number", range(4))
def test_that_lives(number):
    pass

def test_that_ends_its_process_once():
    if not DIED.exists():
        DIED.touch()
        os.kill(os.getpid(), signal.SIGKILL)
"""
DEAD_AT_ITS_END = """
import os, signal

def pytest_sessionfinish(session):
    if hasattr(session.config, "workerinput"):
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def witness() -> Iterator[PauseWitness]:
    witness = PauseWitness()
    if not witness.is_above:
        witness.close()
        pytest.skip("no right to a real-time priority: the witness notes nothing")
    yield witness
    witness.close()


def test_a_pause_is_noted_as_long_as_it_was_and_only_once_it_was(witness: PauseWitness) -> None:
    before_ns = time.monotonic_ns()
    os.kill(witness.pid, signal.SIGSTOP)
    time.sleep(4 * LIMIT_MS / 1000)
    os.kill(witness.pid, signal.SIGCONT)
    while not (noted_ms := witness.longest_ms(before_ns)):
        assert time.monotonic_ns() - before_ns < 10e9
    after_ns = time.monotonic_ns()
    assert 3 * LIMIT_MS < noted_ms <= (after_ns - before_ns) / 1e6
    assert witness.longest_ms(after_ns) == 0.0


@pytest.mark.parametrize(
    ("intervals", "covered"),
    [
        ((), 0),
        (((3, 7),), 4),
        (((5, 9), (1, 4)), 7),
        (((1, 6), (4, 9)), 8),
        (((1, 9), (3, 5), (8, 10)), 9),
        (((1, 4), (1, 4)), 3),
    ],
)
def test_time_that_two_processors_stood_counts_once(
    intervals: tuple[tuple[int, int], ...], covered: int
) -> None:
    assert covered_ns(intervals) == covered
    assert covered == len({tick for begin, end in intervals for tick in range(begin, end)})


def test_short_pauses_count_together_until_they_are_old() -> None:
    ms, pauses = 1_000_000, Pauses()
    ended_ms = [WINDOW_MS // 2 * number for number in range(1, 6)]
    stood = [pauses.add((end - 12) * ms, end * ms) for end in ended_ms]
    assert [stood_ns // ms for stood_ns in stood] == [12, 24, 36, 36, 36]
    assert pauses.add((1000 + WINDOW_MS) * ms, (1002 + WINDOW_MS) * ms) == 2 * ms


def run(folder: Path, tests: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run tests with the hooks of the HIL tests, in a process of their own."""
    (folder / "test_these.py").write_text(tests, encoding="utf-8")
    return subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-p", "hil_tests.conftest"),
            *("-p", "no:cacheprovider", "-q", "-c", str(ROOT / "pyproject.toml")),
            *("--rootdir", str(folder), str(folder), *options),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def run_again(output: str) -> list[str]:
    """Return which tests were run again; each is told with the pause and its failure."""
    lines = [line for line in output.splitlines() if line.startswith("RUN AGAIN")]
    told = [
        re.fullmatch(
            r"RUN AGAIN test_these\.py::(\w+): "
            r"the machine stood for (\d+) ms; test_these\.py:\d+: assert False",
            line,
        )
        for line in lines
    ]
    assert all(each and int(each[2]) > LIMIT_MS for each in told), lines
    return [each[1] for each in told if each]


def test_only_a_test_that_failed_while_the_machine_stood_is_run_again(tmp_path: Path) -> None:
    ended = run(tmp_path, PAUSING + TESTS)
    assert "2 failed, 2 passed, 2 rerun" in ended.stdout, ended.stdout
    expected = ["test_that_fails_for_the_pause", "test_that_fails_with_and_without_a_pause"]
    assert run_again(ended.stdout) == expected


def test_what_was_excused_in_another_process_is_told_too(tmp_path: Path) -> None:
    assert len(run_again(run(tmp_path, PAUSING + TESTS, "-n", "1").stdout)) == 2


def test_an_unsafe_motion_is_never_excused(tmp_path: Path) -> None:
    ended = run(tmp_path, PAUSING + UNSAFE)
    assert not run_again(ended.stdout), ended.stdout
    assert "FAILED test_these.py::test_how_often_they_ran" not in ended.stdout, ended.stdout
    assert ended.stdout.count("UnsafeMotionError: power without any command") >= 6, ended.stdout


def test_a_test_whose_process_died_fails_and_is_named(tmp_path: Path) -> None:
    ended = run(tmp_path, DEAD, "-n", "2")
    assert ended.returncode == pytest.ExitCode.TESTS_FAILED, ended.stdout
    failed = [line for line in ended.stdout.splitlines() if line.startswith("FAILED")]
    assert any("::test_that_ends_its_process_once" in line for line in failed), failed
    assert any(line.startswith("FAILED worker gw") for line in failed), failed
    assert not run_again(ended.stdout)


def test_a_process_that_died_behind_its_tests_fails_the_run(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(DEAD_AT_ITS_END, encoding="utf-8")
    ended = run(tmp_path, "def test_that_passes(): pass", "-n", "1")
    assert "1 passed" in ended.stdout, ended.stdout
    assert ended.returncode == pytest.ExitCode.TESTS_FAILED, ended.stdout
    assert "FAILED worker gw0: " in ended.stdout
