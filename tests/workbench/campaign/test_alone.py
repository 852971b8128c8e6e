import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

from robotctl.workbench.campaign.alone import (
    Program,
    clear_abandoned,
    run_alone,
    runs_end_with_this,
)

_seen: list[str] = []


def main() -> None:
    """Do what the first argument says, as `robotctl` would do it."""
    what, *_, option, file = sys.argv[1:]
    assert option == "--report"
    _seen.append(what)
    match what:
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "hang":
            time.sleep(60.0)
        case "refuse":
            sys.stderr.write("some words\nrobotctl: the reason\n\n")
            sys.exit(2)
        case "break":
            raise RuntimeError("broken")
    Path(file).write_text(" ".join(_seen))
    sys.exit(3 if what == "fail" else 0)


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("die", "its process was ended by SIGKILL"),
        ("hang", "not over after 1 s of this computer's time"),
        ("refuse", "status 2: robotctl: the reason"),
        ("break", "status 1: RuntimeError: broken"),
    ],
)
def test_a_run_that_dies_hangs_or_fails_has_no_result_but_a_reason(what, reason):
    ending = run_alone(Program(main), (what,), 1.0 if what == "hang" else 60.0)
    assert (ending.report, ending.reason) == (b"", reason)


def test_a_run_is_told_whether_it_passed_or_not_and_nothing_of_it_reaches_the_next():
    for what in ("pass", "fail", "pass"):
        ending = run_alone(Program(main), (what,), 60.0)
        assert (ending.report, ending.reason) == (what.encode(), "")


def test_the_folder_of_a_run_whose_process_was_killed_is_removed_by_the_next(tmp_path, monkeypatch):
    here = "import tests.workbench.campaign.test_alone as here; "
    code = f"{here}here.run_alone(here.Program(here.main), ['hang'], 60.0)"
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    waits = subprocess.Popen([sys.executable, "-c", code], env=environment)
    while not [*tmp_path.glob("robotctl-run-*/output")]:
        assert waits.poll() is None
        time.sleep(0.05)
    (left,) = tmp_path.glob("robotctl-run-*")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    clear_abandoned()
    assert left.exists()  # still in use
    waits.kill()
    waits.wait()
    clear_abandoned()
    assert not left.exists()


def test_runs_end_with_what_they_are_for():
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(run_alone(Program(main), ("hang",), 60.0)))
        for _ in range(3)
    ]
    began_s = time.monotonic()

    def interrupted() -> None:
        with runs_end_with_this(lambda: [each.join() for each in threads]):
            for each in threads:
                each.start()
            time.sleep(1.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - began_s < 30.0
    assert len(found) == 3
    assert {each.reason for each in found} <= {
        "its process was ended by SIGKILL",
        "stopped before it began",
    }
    assert run_alone(Program(main), ("pass",), 60.0).report == b"pass"
