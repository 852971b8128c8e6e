"""What the tool of reaction times runs, and what it says of the rest."""

import sys

import pytest

import reactions


@pytest.mark.parametrize(("robot", "missing"), [("diff_drive", 0), ("tricycle", 2)])
def test_a_fault_of_a_part_that_the_robot_has_not_is_named_and_not_measured(
    monkeypatch, capsys, robot, missing
):
    measured = []

    def measure(_robot, row, _seed):
        measured.append(row)
        return row.limit_ms

    monkeypatch.setattr(reactions, "measure", measure)
    monkeypatch.setattr(sys, "argv", ["reactions.py", "--robot", robot, "--repeats", "1"])
    assert reactions.main() == 0
    told = capsys.readouterr().out.splitlines()
    named = [line for line in told if line.startswith(f"not run, {robot} cannot feel it: ")]
    count = len(reactions.ROWS) - missing
    assert len(measured) == count
    assert len(named) == missing
    assert told[-1] == f"0 of {count} reactions later than their limit"
    assert not any(f"| {line.rpartition(': ')[2]} |" in row for line in named for row in told)
