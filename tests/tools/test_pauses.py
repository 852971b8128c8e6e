"""Which failed HIL tests say nothing, and are run again: those in whose time the machine stood."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil_tests.pauses import LIMIT_MS, WINDOW_MS, Pauses, PauseWitness, covered_ns

ROOT = Path(__file__).resolve().parents[2]
TESTS = """
import os, signal, time
from hil_tests.conftest import WITNESS

runs = []

def pause(config):
    os.kill(config.stash[WITNESS].pid, signal.SIGSTOP)
    time.sleep(0.1)
    os.kill(config.stash[WITNESS].pid, signal.SIGCONT)
    began_ns = time.monotonic_ns()
    while not config.stash[WITNESS].longest_ms(0):
        assert time.monotonic_ns() - began_ns < 10e9

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


def test_only_a_test_that_failed_while_the_machine_stood_is_run_again(
    witness: PauseWitness, tmp_path: Path
) -> None:
    assert witness.is_above
    (tmp_path / "test_four.py").write_text(TESTS, encoding="utf-8")
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-p", "hil_tests.conftest"),
            *("-p", "no:cacheprovider", "-q", "-c", str(ROOT / "pyproject.toml")),
            *("--rootdir", str(tmp_path), str(tmp_path)),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "2 failed, 2 passed, 2 rerun" in ended.stdout, ended.stdout
    again = [line for line in ended.stdout.splitlines() if line.startswith("RUN AGAIN")]
    assert len(again) == 2
    assert all("The machine stood for" in line for line in again)
    assert "test_that_fails_for_the_pause" in again[0]
