"""The simulator's process among others: whom the scheduler lets go first."""

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[2] / "configs"
PRIORITY = 7


def fifo_is_permitted() -> bool:
    ask = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))"
    asked = subprocess.run((sys.executable, "-c", ask), capture_output=True, check=False)
    return asked.returncode == 0


def scheduled(process: int) -> dict[int, tuple[int, int]]:
    """Policy and priority of each thread that lives at the moment."""
    found = {}
    for thread in (int(each.name) for each in Path(f"/proc/{process}/task").iterdir()):
        with contextlib.suppress(ProcessLookupError):
            policy, parameters = os.sched_getscheduler(thread), os.sched_getparam(thread)
            found[thread] = (policy, parameters.sched_priority)
    return found


def test_the_loop_comes_before_who_publishes_and_both_before_ordinary_tasks(tmp_path):
    if not fifo_is_permitted():
        pytest.skip(f"SCHED_FIFO {PRIORITY} is not permitted here")
    command = (
        *(sys.executable, "-m", "firmware_sim", "--robot", str(CONFIGS / "diff_drive.toml")),
        *("--world", str(CONFIGS / "worlds" / "empty_room.toml")),
        *("--bus", f"simcan:{tmp_path / 'bus'}", "--truth", f"ipc://{tmp_path / 'truth'}"),
        *("--priority", str(PRIORITY)),
    )
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
        try:
            assert b"ready" in process.stdout.readline()
            deadline_s = time.monotonic() + 10.0
            taken = {}
            while set(taken.values()) != {(os.SCHED_FIFO, PRIORITY), (os.SCHED_FIFO, PRIORITY - 1)}:
                assert time.monotonic() < deadline_s, taken
                taken = scheduled(process.pid)
            assert taken[process.pid] == (os.SCHED_FIFO, PRIORITY)
            assert len(taken) > 1
        finally:
            process.terminate()
