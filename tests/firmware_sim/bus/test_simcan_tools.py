"""Programs that know nothing of simcan work on it: python-can's and cantools' own, as processes."""

import contextlib
import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

ROOT = Path(__file__).resolve().parents[3]


def until(condition, timeout_s=30.0):
    """Wait for a condition with a deadline; return its first true value."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"{condition} did not come true within {timeout_s} s")


def take_interrupts():
    """Let a program end by SIGINT, also where the tests run in the background of a shell."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def start():
    """Start a program of this Python; killed at the end if it still runs."""
    running = []

    def begin(*arguments, **options):
        options.setdefault("stdout", subprocess.PIPE)
        options.setdefault("stderr", subprocess.STDOUT)
        options.setdefault("env", {**os.environ, "PYTHONUNBUFFERED": "1"})
        process = subprocess.Popen(
            [sys.executable, *arguments],
            cwd=ROOT,
            text=True,
            preexec_fn=take_interrupts,  # noqa: PLW1509 - one system call
            **options,
        )
        running.append(process)
        return process

    yield begin
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def hub(start, runtime_directory):
    process = start("-m", "firmware_sim.bus", "--ack", "--log", str(runtime_directory / "hub.log"))
    until((runtime_directory / "robotctl" / "simcan0.sock").exists)
    return process


def has_taken_all(bus, log):
    """Send frames of no meaning until a logger's buffer has brought one of them to the disk."""
    for _ in range(50):
        bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False), 1.0)
    return log.exists() and b"7FF#" in log.read_bytes()


def numbers(log):
    """Return the first byte of each frame 0x181 of a log."""
    frames = can.CanutilsLogReader(log)
    return [frame.data[0] for frame in frames if frame.arbitration_id == 0x181]


def test_the_logger_writes_and_the_player_repeats(hub, start, runtime_directory):
    first, second = runtime_directory / "first.log", runtime_directory / "second.log"
    logger = start("-m", "can.logger", "-i", "simcan", "-c", "simcan0", "-f", str(first))
    until(lambda: "Started" in logger.stdout.readline())
    with can.Bus(interface="simcan", channel="simcan0") as bus:
        for number in range(30):
            bus.send(can.Message(arbitration_id=0x181, data=[number], is_extended_id=False), 1.0)
        until(lambda: has_taken_all(bus, first))
    logger.send_signal(signal.SIGINT)
    assert logger.wait(30) == 0
    again = start("-m", "can.logger", "-i", "simcan", "-c", "simcan0", "-f", str(second))
    until(lambda: "Started" in again.stdout.readline())
    played = runtime_directory / "played.log"
    lines = first.read_text(encoding="utf-8").splitlines(keepends=True)
    played.write_text("".join(line for line in lines if " 181#" in line), encoding="utf-8")
    player = start("-m", "can.player", "-i", "simcan", "-c", "simcan0", str(played))
    assert player.wait(30) == 0, player.communicate()
    with can.Bus(interface="simcan", channel="simcan0") as bus:
        until(lambda: has_taken_all(bus, second))
    again.send_signal(signal.SIGINT)
    assert again.wait(30) == 0
    assert numbers(first) == numbers(second) == list(range(30))
    hub.send_signal(signal.SIGTERM)
    assert hub.wait(30) == 0
    assert numbers(runtime_directory / "hub.log") == [*range(30), *range(30)]


def test_cantools_monitor_shows_decoded_signals(hub, start):
    master, slave = pty.openpty()
    os.set_blocking(master, False)
    environment = {**os.environ, "TERM": "xterm", "LINES": "40", "COLUMNS": "120"}
    monitor = start(
        "-m",
        "cantools",
        "monitor",
        "-i",
        "simcan",
        "-c",
        "simcan0",
        "configs/robot.dbc",
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env=environment,
    )
    os.close(slave)
    screen = b""

    def shown():
        nonlocal screen
        if select.select([master], [], [], 0.05)[0]:
            with contextlib.suppress(OSError):  # the program has ended
                screen += os.read(master, 65536)
        assert monitor.poll() is None, screen.decode()
        bus.send(
            can.Message(
                arbitration_id=0x183,
                data=bytes.fromhex("000000002E0D0000"),
                is_extended_id=False,
            ),
            1.0,
        )
        return b"Battery(" in screen and b"Voltage" in screen

    with can.Bus(interface="simcan", channel="simcan0") as bus:
        until(shown)
    os.write(master, b"q")
    assert monitor.wait(30) == 0
    os.close(master)


def test_the_hub_refuses_a_taken_channel_with_status_2(hub, start):
    second = start("-m", "firmware_sim.bus")
    output, _ = second.communicate(timeout=30)
    assert second.returncode == 2
    assert f"already running on it (process {hub.pid}" in output


def test_a_missing_interface_is_named(start):
    process = start("-m", "firmware_sim.bus", "--channel", "bridged", "--bridge", "nocan0")
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 2
    assert "nocan0" in output


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_hub_stops_orderly_on_a_signal(hub, runtime_directory, number):
    with can.Bus(interface="simcan", channel="simcan0") as bus:
        hub.send_signal(number)
        assert hub.wait(30) == 0
        with pytest.raises(can.CanOperationError, match="hub is gone"):
            bus.recv(5.0)
    assert not (runtime_directory / "robotctl" / "simcan0.sock").exists()
