"""No process of the robot outlives the one that started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PARENT = """
import signal, sys, time
for number in (signal.SIGHUP, signal.SIGTERM):  # pytest may have been started by nohup
    signal.signal(number, signal.SIG_DFL)
from robotctl.app.supervision.child_process import start_child
child = start_child([sys.executable, "-c", "import time; time.sleep(60)"])
print(child.pid, flush=True)
time.sleep(60)
"""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP, signal.SIGTERM])
def test_a_child_ends_with_its_parent_however_that_ends(number: int) -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert alive(child)
        parent.send_signal(number)
        parent.wait(10)
    deadline_s = time.monotonic() + 10
    while alive(child):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


FORK = """
import os, signal, sys
from robotctl.app.supervision.child_process import start_child
signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGUSR1,))
def note():
    held = signal.SIGUSR1 in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    os.write(1, b"held back\\n" if held else b"fatal\\n")
os.register_at_fork(after_in_child=note)
start_child(["/bin/true"]).wait()
free = signal.SIGUSR1 not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
print("the parent takes it" if free else "the parent lost it", flush=True)
"""


def test_an_emergency_stop_ends_no_child_from_its_first_instruction_on() -> None:
    said = subprocess.run([sys.executable, "-c", FORK], stdout=subprocess.PIPE, check=True).stdout
    assert said.splitlines() == [b"held back", b"the parent takes it"]


def test_a_command_is_found_by_its_name_and_survives_an_emergency_stop() -> None:
    command = [
        sys.executable,
        "-m",
        "robotctl",
        "mavlink",
        "monitor",
        "--link",
        "udpin:127.0.0.1:0",
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        name = Path(f"/proc/{process.pid}/comm")
        deadline_s = time.monotonic() + 10
        while name.read_text() != "robotctl\n":
            assert time.monotonic() < deadline_s
        process.send_signal(signal.SIGUSR1)
        process.send_signal(signal.SIGTERM)  # handled after it: the lower number comes first
        assert process.wait(10) == -signal.SIGTERM
