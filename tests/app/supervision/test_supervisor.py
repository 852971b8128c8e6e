"""`robotctl run` on a terminal, under systemd."""

import itertools
import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotctl.app.supervision.stack import (
    CONTROL,
    TELEMETRY,
)
from robotctl.messages.control import SafetyState
from tests.app.supervision.bench import DEADLINE_S, Ear, Run, wait


@pytest.fixture
def run(
    channel: str, ear: Ear, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Run]:
    made = Run(channel, tmp_path / "record", tmp_path_factory.mktemp("manager") / "notify")

    def ready() -> bool:
        made.told()
        assert made.process.poll() is None, made.output
        return made.said("ready:")

    wait(ready, "the robot is ready")
    made.told()
    yield made
    made.process.terminate()
    made.process.wait(DEADLINE_S)
    os.close(made.terminal)
    made.manager.close()


def test_sigusr1_to_the_supervisor_stops_the_robot(run: Run, ear: Ear) -> None:
    pid = run.child(CONTROL)
    run.process.send_signal(signal.SIGUSR1)
    wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    assert run.child(CONTROL) == pid


def test_sigusr1_straight_to_the_control_process_stops_the_robot(run: Run, ear: Ear) -> None:
    pid = run.child(CONTROL)
    os.kill(run.process.pid, signal.SIGSTOP)  # no supervisor helps
    try:
        os.kill(pid, signal.SIGUSR1)
        wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    finally:
        os.kill(run.process.pid, signal.SIGCONT)
    assert run.child(CONTROL) == pid


def test_a_key_in_the_terminal_stops_the_robot(run: Run, ear: Ear) -> None:
    assert run.said("Space or e")
    os.write(run.terminal, b"x")
    time.sleep(0.3)  # that nothing follows has no sign to wait for
    assert not ear.is_in(SafetyState.EMERGENCY_STOP)
    os.write(run.terminal, b" ")
    wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")


def test_an_end_is_said_and_logged_and_sigterm_ends_the_robot_in_order(run: Run) -> None:
    os.kill(run.child(TELEMETRY), signal.SIGKILL)
    wait(lambda: run.said("telemetry ended after"), "the end is said")
    (line,) = (run.record / "exits.jsonl").read_text().splitlines()
    assert json.loads(line)["status"] == -signal.SIGKILL
    run.process.terminate()
    assert run.process.wait(DEADLINE_S) == 0


def test_why_the_robot_stopped_is_said_though_the_end_follows_at_once(run: Run, ear: Ear) -> None:
    """As where the CAN adapter is unplugged: systemd ends the service."""
    os.kill(run.process.pid, signal.SIGSTOP)  # it reads nothing before it is to end
    try:
        os.kill(run.child(CONTROL), signal.SIGUSR1)
        wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
        run.process.terminate()
    finally:
        os.kill(run.process.pid, signal.SIGCONT)
    assert run.process.wait(DEADLINE_S) == 0
    assert run.said("stopped: ")


def test_systemd_hears_of_a_control_loop_that_stands_by_hearing_nothing(run: Run) -> None:
    assert run.ready
    wait(lambda: "WATCHDOG=1" in run.told(), "the watchdog is fed")
    os.kill(run.child(CONTROL), signal.SIGSTOP)
    stopped_s = time.monotonic()
    fed_s: list[float] = []

    def fed_again() -> bool:
        fed_s.extend([time.monotonic()] * run.told().count("WATCHDOG=1"))
        return bool(fed_s) and fed_s[-1] - stopped_s > 1.0 and run.said("it hung")

    wait(fed_again, "the watchdog is fed for the new control process")
    gaps_s = [after - before for before, after in itertools.pairwise([stopped_s, *fed_s])]
    assert max(gaps_s) > 1.0  # the supervisor lived and watched, and yet did not feed it
