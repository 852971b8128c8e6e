"""The table of reaction times."""

import json
import os
import signal
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
        return "", ["RUN AGAIN one"]

    monkeypatch.setattr(soak, "repeat", one_round)
    monkeypatch.setattr(sys, "argv", ["soak.py", "--repeats", "3"])
    assert soak.main() == 1
    told = capsys.readouterr().out
    assert "| cut | 3.0 / 3.0 (1) |" in told
    assert told.endswith("0 of 1 repeats failed, 1 tests run again\n")
