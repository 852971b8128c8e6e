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
from soak import CODE, ROOT, SUITE, Repeat, state_of_code


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

    def one_round(_options, state, _number):
        if rounds:
            os.kill(os.getpid(), signal.SIGTERM)
        rounds.append(1)
        return Repeat(state, "simcan", 0, ("RUN AGAIN one",), {"cut": [3.0]})

    monkeypatch.setattr(soak, "repeat", one_round)
    monkeypatch.setattr(sys, "argv", ["soak.py", "--repeats", "3"])
    assert soak.main() == 1
    told = capsys.readouterr().out
    assert "| cut | 3.0 / 3.0 (1) |" in told
    assert told.endswith(
        "1 of 3 repeats done, the next one cut short; none failed, "
        "1 tests run again; exit status 0 of 1\n"
    )


seeds: list[int] = []
"""Those of all repeats of a test."""


@pytest.fixture(autouse=True)
def no_seeds():
    seeds.clear()


def soak_of(monkeypatch, *statuses, repeats=None, keep=None):
    """Run as many repeats as there are exit statuses, each of which took 7 ms for one reaction."""
    ends = iter(statuses)

    def run(command, **_options):
        seeds.append(int(command[command.index("--seed") + 1]))
        reactions = Path(command[command.index("--reactions") + 1])
        reactions.write_text(line("cut", "simcan", 7.0), encoding="utf-8")
        return subprocess.CompletedProcess((), next(ends), "RUN AGAIN a test\n", "")

    monkeypatch.setattr(soak.subprocess, "run", run)
    argv = ["soak.py", "--repeats", str(repeats or len(statuses))]
    monkeypatch.setattr(sys, "argv", argv + (["--keep", str(keep)] if keep else []))
    return soak.main()


def test_a_repeat_that_was_killed_without_a_word_fails_the_soak(
    monkeypatch, capsys, on_termination
):
    assert soak_of(monkeypatch, 0, -signal.SIGKILL, 1, 0, 1) == 1
    told = capsys.readouterr().out
    assert told.endswith(
        "5 of 5 repeats done; 3 failed, 5 tests run again; exit status 0 of 2, 1 of 2, -9 of 1\n"
    )


def test_a_soak_of_which_all_repeats_passed_says_so(monkeypatch, capsys, on_termination):
    assert soak_of(monkeypatch, 0, 0) == 0
    told = capsys.readouterr().out
    assert told.endswith(
        "2 of 2 repeats done; none failed, 2 tests run again; exit status 0 of 2\n"
    )


def test_a_soak_goes_on_behind_the_repeats_that_are_kept(
    monkeypatch, capsys, tmp_path, on_termination
):
    file = tmp_path / "runs" / "soak.jsonl"  # a folder that is not there yet
    assert soak_of(monkeypatch, 0, 1, keep=file) == 1
    capsys.readouterr()
    assert soak_of(monkeypatch, 0, 0, repeats=4, keep=file) == 1
    told = capsys.readouterr().out
    assert "| cut | 7.0 / 7.0 (4) |" in told
    assert told.endswith(
        "4 of 4 repeats done, 2 of them earlier; 1 failed, 4 tests run again; "
        "exit status 0 of 3, 1 of 1\n"
    )
    assert seeds == [1, 2, 3, 4]
    outputs = [json.loads(each)["output"] for each in file.read_text(encoding="utf-8").splitlines()]
    assert outputs == ["", "RUN AGAIN a test\n", "", ""]  # what a failed test said is kept


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        ('{"state":"0123456789ab","bus":"simcan","status":0}', "a repeat of state 0123456789ab"),
        (
            '{"state":"STATE","bus":"vcan0","status":0}',
            f"a repeat of state {state_of_code(ROOT)} on vcan0",
        ),
        ('{"state":"STATE","bus":"sim', "no repeat of a soak"),
    ],
    ids=["another state", "another bus", "a cut line"],
)
def test_repeats_of_something_else_are_not_counted(
    monkeypatch, capsys, tmp_path, on_termination, kept, said
):
    file = tmp_path / "soak.jsonl"
    file.write_text(kept.replace("STATE", state_of_code(ROOT)), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        soak_of(monkeypatch, 0, keep=file)
    assert ended.value.code == 2
    assert f"{file}:1: {said}" in capsys.readouterr().err


def test_the_state_of_the_code_changes_with_any_file_of_it(tmp_path):
    for folder in CODE:
        (tmp_path / folder).mkdir()
    file = tmp_path / CODE[0] / "robot.toml"
    file.write_text("a = 1", encoding="utf-8")
    before = state_of_code(tmp_path)
    assert state_of_code(tmp_path) == before
    (tmp_path / "README.md").write_text("no code", encoding="utf-8")
    assert state_of_code(tmp_path) == before
    file.write_text("a = 2", encoding="utf-8")
    assert state_of_code(tmp_path) != before
    file.write_text("a = 1", encoding="utf-8")
    file.rename(file.with_name("other.toml"))
    assert state_of_code(tmp_path) != before
