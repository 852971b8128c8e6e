"""No simulator outlives the process that started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CHILD = """
import time
from firmware_sim.parent import end_with_parent
end_with_parent()
print("ready", flush=True)
time.sleep(60)
"""
PARENT = f"""
import subprocess, sys, threading, time
def start():
    global child
    child = subprocess.Popen([sys.executable, "-c", {CHILD!r}], stdout=subprocess.PIPE)
    child.stdout.readline()
starting = threading.Thread(target=start)
starting.start()
starting.join()
time.sleep(0.2)
print(child.pid, child.poll(), flush=True)
time.sleep(60)
"""


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_simulator_ends_with_its_parent_but_not_with_a_thread_of_it(number: int) -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child, status = parent.stdout.readline().split()
        assert status == b"None", "it ended with the thread that had started it"
        os.kill(parent.pid, number)
    deadline_s = time.monotonic() + 10
    while alive(int(child)):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_a_simulator_that_still_compiles_ends_at_once_with_its_parent(tmp_path: Path) -> None:
    script = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-m', 'firmware_sim', '--robot', 'diff_drive',"
        f" '--world', 'flat', '--bus', 'simcan:{tmp_path.name}'], stderr=subprocess.DEVNULL)\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    uncached = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, env=uncached
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        while not any(tmp_path.rglob("*.nb?")):  # it has compiled its first function
            time.sleep(0.02)
        parent.kill()
    deadline_s = time.monotonic() + 5
    while alive(child):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
