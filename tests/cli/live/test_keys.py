"""Keys of the terminal view, on a pseudo-terminal of a process of its own."""

import contextlib
import io
import os
import pty
import subprocess
import sys

import pytest

from robotctl.cli.live.keys import Keys

PROGRAM = """
import os, sys, termios, time
from robotctl.cli.live.keys import Keys
os.close(os.open(os.ttyname(0), os.O_RDWR))  # becomes the controlling terminal
before = termios.tcgetattr(0)
with Keys() as keys:
    assert keys.usable and termios.tcgetattr(0) != before
    print("go", flush=True)
    end_s = time.monotonic() + float(sys.argv[1])
    while not (stop := keys.emergency()) and time.monotonic() < end_s:
        time.sleep(0.01)
    again = keys.emergency()
assert termios.tcgetattr(0) == before
print("stop:", stop, again)
"""


def in_a_terminal(typed: bytes, patience_s: float) -> str:
    """Type into `PROGRAM` once it has said `go`; return all that its terminal showed."""
    terminal, child = pty.openpty()
    command = [sys.executable, "-c", PROGRAM, str(patience_s)]
    with subprocess.Popen(
        command, stdin=child, stdout=child, stderr=child, start_new_session=True
    ) as process:
        os.close(child)
        output = b""
        with contextlib.suppress(OSError):  # its end closes the terminal
            while b"go" not in output:
                output += os.read(terminal, 1024)
            os.write(terminal, typed)
            while True:
                output += os.read(terminal, 1024)
    os.close(terminal)
    assert process.returncode == 0, output.decode()
    return output.decode()


@pytest.mark.parametrize(
    ("typed", "stops"),
    [
        (b" ", True),
        (b"e", True),
        (b"E", True),
        (b"xe", True),
        (b"x\n", False),
        (b"\x1ae", True),  # Ctrl-Z
        (b"\x13e", True),  # Ctrl-S
    ],
)
def test_only_the_emergency_keys_stop_and_need_no_enter(typed: bytes, stops: bool) -> None:
    output = in_a_terminal(typed, 20.0 if stops else 0.5)
    assert f"stop: {stops} False" in output
    assert "x" not in output  # keys are not shown


WITHOUT_A_TERMINAL = """
import os, signal, time
from robotctl.cli.live.keys import Keys
signal.signal(signal.SIGHUP, signal.SIG_IGN)
os.close(os.open(os.ttyname(0), os.O_RDWR))
with Keys() as keys:
    print("go", flush=True)
    while keys.usable:
        keys.emergency()
        os.isatty(0) or exit("as it should")
        time.sleep(0.01)
"""


def test_a_terminal_that_is_closed_meanwhile_is_no_error() -> None:
    terminal, child = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", WITHOUT_A_TERMINAL],
        stdin=child,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as process:
        os.close(child)
        assert process.stdout is not None
        assert process.stdout.readline() == "go\n"
        os.close(terminal)
        _, said = process.communicate(timeout=20.0)
    assert said.strip() == "as it should"


def test_without_a_terminal_there_are_no_keys() -> None:
    with Keys(io.StringIO(" e")) as keys:
        assert not keys.usable
        assert not keys.emergency()
