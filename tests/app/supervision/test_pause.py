"""What a process does that makes no progress, by the kernel's words."""

import os
import signal
import subprocess
import sys
import time

import pytest

from robotctl.app.supervision.pause import Pause, killed_for_memory, state_of


@pytest.fixture
def sleeper():
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(100)"]) as process:
        yield process
        process.kill()


def becomes(pid, words):
    deadline_s = time.monotonic() + 10
    while state_of(pid) != words and time.monotonic() < deadline_s:
        time.sleep(0.01)
    return state_of(pid) == words


def test_a_stopped_a_waiting_and_an_ended_process_are_told_apart(sleeper):
    assert becomes(sleeper.pid, "waits for something")
    sleeper.send_signal(signal.SIGSTOP)
    assert becomes(sleeper.pid, "stopped by a signal")
    sleeper.send_signal(signal.SIGCONT)
    sleeper.kill()
    assert becomes(sleeper.pid, "has ended")
    sleeper.wait()
    assert state_of(sleeper.pid) == ""


def test_a_busy_process_computes():
    assert state_of(os.getpid()) == "computes, or gets no processor"


def test_the_words_say_how_long_and_why():
    pause = Pause("navigation", 7, 1.04, "stopped by a signal", False)
    assert pause.words() == ("navigation is held up: no progress for 1.0 s (stopped by a signal)")
    over = Pause("navigation", 7, 2.26, "", True)
    assert over.words() == "navigation was held up for 2.3 s; it goes on"


def test_killings_for_want_of_memory_are_counted_by_the_kernel():
    assert killed_for_memory() >= 0
