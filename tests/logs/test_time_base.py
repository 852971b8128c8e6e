"""The host's log of the bus and the simulator's tell the same times, whatever holds one up."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from robotctl.config.options import StackOptions, options_of_command_line
from robotctl.config.robot_file import find_file
from robotctl.drivers.can.candump import CandumpReader
from robotctl.drivers.can.config import CanConfig
from robotctl.runtime.clock import wall_offset_ns

EPOCH_NS = 1_600_000_000_000_000_000
HELD_UP_S = 0.4


def entries(text: str) -> list[tuple[str, str]]:
    """Return time and frame of each line; a half one at the end of a file is none."""
    fields = [line.split() for line in text.splitlines(keepends=True) if line.endswith("\n")]
    return [(when, frame) for when, _, frame in fields]


def heard(reader: CandumpReader, seconds: float) -> list[tuple[str, str]]:
    """Return what comes over a while."""
    deadline_s = time.monotonic() + seconds
    found = []
    while time.monotonic() < deadline_s:
        found += entries("".join(reader.read()))
        time.sleep(0.01)
    return found


def test_a_simulator_that_was_held_up_logs_its_frames_at_the_times_that_others_hear_them(
    tmp_path: Path,
) -> None:
    channel, log = str(tmp_path / "bus"), tmp_path / "simulator.log"
    command = (
        *(sys.executable, "-m", "firmware_sim", "--robot", str(find_file("diff_drive"))),
        *("--world", str(find_file("flat", "worlds")), "--bus", f"simcan:{channel}"),
        *("--log", str(log), "--epoch-ns", str(EPOCH_NS)),
    )
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            assert b"ready" in process.stdout.readline()
            reader = CandumpReader(CanConfig("simcan", channel), EPOCH_NS)
            before = heard(reader, 0.5)
            os.kill(process.pid, signal.SIGSTOP)
            time.sleep(HELD_UP_S)
            os.kill(process.pid, signal.SIGCONT)
            after = heard(reader, 0.5)
            reader.close()
        finally:
            process.terminate()
            process.wait()
    logged = set(entries(log.read_text(encoding="ascii")))
    assert len(before) > 10
    assert len(after) > 10
    assert set(before) <= logged
    assert set(after) <= logged
    gap_s = float(after[-1][0].strip("()")) - float(before[0][0].strip("()"))
    assert gap_s > HELD_UP_S


def test_all_processes_of_a_robot_are_given_one_epoch() -> None:
    options = StackOptions("robot", "robot.toml")
    given = options_of_command_line(options.command("module")[2:])
    assert given.epoch_ns == options.epoch_ns
    assert abs(options.epoch_ns - wall_offset_ns()) < 50_000_000
