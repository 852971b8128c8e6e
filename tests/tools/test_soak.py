"""The table of reaction times."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import soak
from reactions import reaction_table
from soak import SUITE


def line(fault, bus, ms):
    return json.dumps({"fault": fault, "bus": bus, "ms": ms})


def test_each_fault_has_a_row_and_each_bus_a_column_with_median_greatest_and_count():
    lines = [line("cut", "simcan", ms) for ms in (3.0, 1.0, 2.5)] + [line("cut", "vcan0", 7.0)]
    lines.append(line("mute", "vcan0", 4.0))
    assert reaction_table(lines).splitlines() == [
        "| fault | simcan | vcan0 |",
        "| --- | --- | --- |",
        "| cut | 2.5 / 3.0 (3) | 7.0 / 7.0 (1) |",
        "| mute |  | 4.0 / 4.0 (1) |",
    ]


def test_the_suite_holds_the_tests_of_stops_and_of_faults():
    assert "hil_tests/test_6_safety_stops.py" in SUITE
    assert "hil_tests/test_9_host_faults.py" in SUITE


@pytest.fixture
def on_termination():
    """The handler of SIGTERM is as it was after the test."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def test_a_soak_ended_early_tells_what_was_measured_until_then(monkeypatch, capsys, on_termination):
    rounds = []

    def one_round(_options, reactions: Path):
        if rounds:
            os.kill(os.getpid(), signal.SIGTERM)
        rounds.append(1)
        reactions.write_text(line("cut", "simcan", 3.0), encoding="utf-8")
        return 0, "", ["RUN AGAIN one"]

    monkeypatch.setattr(soak, "repeat", one_round)
    monkeypatch.setattr(sys, "argv", ["soak.py", "--repeats", "3"])
    assert soak.main() == 1
    told = capsys.readouterr().out
    assert "| cut | 3.0 / 3.0 (1) |" in told
    assert told.endswith(
        "1 of 3 repeats done, the next one cut short; none failed, "
        "1 tests run again; exit status 0 of 1\n"
    )


def soak_of(monkeypatch, *statuses):
    """Run as many repeats as there are exit statuses, each of which tells nothing."""
    ends = iter(statuses)

    def run(*_arguments, **_options):
        return subprocess.CompletedProcess((), next(ends), "", "")

    monkeypatch.setattr(soak.subprocess, "run", run)
    monkeypatch.setattr(sys, "argv", ["soak.py", "--repeats", str(len(statuses))])
    return soak.main()


def test_a_repeat_that_was_killed_without_a_word_fails_the_soak(
    monkeypatch, capsys, on_termination
):
    assert soak_of(monkeypatch, 0, -signal.SIGKILL, 1, 0, 1) == 1
    told = capsys.readouterr().out
    assert told.endswith(
        "5 of 5 repeats done; 3 failed, 0 tests run again; exit status 0 of 2, 1 of 2, -9 of 1\n"
    )


def test_a_soak_of_which_all_repeats_passed_says_so(monkeypatch, capsys, on_termination):
    assert soak_of(monkeypatch, 0, 0) == 0
    told = capsys.readouterr().out
    assert told.endswith(
        "2 of 2 repeats done; none failed, 0 tests run again; exit status 0 of 2\n"
    )
