"""How far a run in lockstep is: nothing of a short one, a line now and then of a long one."""

import io
import time

import pytest
from rich.console import Console

from robotctl.cli.live.lockstep_progress import LockstepProgress
from tests.cli.live.test_view import MOVING, NAVIGATION


@pytest.mark.parametrize(("seconds", "lines"), [(1.9, 0), (4.9, 0), (5.1, 1), (16.0, 3)])
def test_without_a_terminal_there_is_a_line_each_five_seconds(
    seconds: float, lines: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    console = Console(file=io.StringIO(), width=120)
    with LockstepProgress(console, 300.0) as progress:
        for step in range(round(seconds * 10)):
            now_s = 100.0 + step / 10 + 0.1
            progress.tell(MOVING, NAVIGATION)
    told = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(told) == lines
    assert all("of at most 300 s simulated, item 1 of 5 south wall" in line for line in told)


def test_on_a_terminal_the_line_renews_itself_after_two_seconds_and_goes_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    console = Console(file=io.StringIO(), width=120, force_terminal=True)
    with LockstepProgress(console, 300.0) as progress:
        now_s += 1.9
        progress.tell(MOVING, NAVIGATION)
        assert console.file.getvalue() == ""  # type: ignore[attr-defined]
        now_s += 0.2
        progress.tell(MOVING, NAVIGATION)
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "south wall" in shown
    assert shown.endswith("\x1b[2K")
