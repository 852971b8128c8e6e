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

from hil_tests.pauses import LIMIT_MS, PauseWitness

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
