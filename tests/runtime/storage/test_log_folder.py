"""Logs that are being written: nobody completes, removes or empties them."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from firmware_sim.bus.core import Bus
from firmware_sim.bus.log import LogWriter
from robotctl.config.robot_file import find_file, load_robot
from robotctl.logs.logs import BusLog, StateLog, recover_all
from robotctl.logs.mcap.recovery import is_complete
from robotctl.messages.control import Notice
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder, refusal
from robotctl.runtime.storage.ring_file import is_written
from tests.cli.command import status_of

BUSES = load_robot(find_file("diff_drive")).buses
SMALL = LogConfig(file_mb=0.1, total_mb=1.0)


def log_states(folder: LogFolder) -> StateLog:
    """Return a log of states with one flushed message in it."""
    log = StateLog(folder, 0, "rover")
    log.step([Notice(0, 6, "driving")], 10**9)
    return log


def log_bus(folder: LogFolder) -> BusLog:
    log = BusLog(folder, BUSES, 0)
    log._write("a frame\n")
    return log


def log_simulated_bus(folder: LogFolder) -> LogWriter:
    return LogWriter(Bus(), folder.new("can", "log"))


WRITERS = pytest.mark.parametrize("writer", [log_states, log_bus, log_simulated_bus])


def test_a_log_that_is_being_written_is_not_recovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = log_states(LogFolder(tmp_path, SMALL))
    (path,) = tmp_path.iterdir()
    inode = path.stat().st_ino
    assert status_of("record", "recover", path) == 2
    assert "is still being written" in capsys.readouterr().err
    assert recover_all(LogFolder(tmp_path, SMALL)) == ()
    assert path.stat().st_ino == inode
    log.close()
    assert is_complete(path)


@WRITERS
def test_a_log_that_is_being_written_makes_no_room_for_others(
    tmp_path: Path, writer: Callable[[LogFolder], Any]
) -> None:
    folder = LogFolder(tmp_path, SMALL)
    log = writer(folder)
    (path,) = tmp_path.iterdir()
    os.utime(path, (0, 0))
    old, new = tmp_path / "control-0001.rec", tmp_path / "control-0002.rec"
    for number, other in enumerate((old, new), start=1):
        other.write_bytes(bytes(600_000))
        os.utime(other, (number, number))
    folder.trim()
    assert path.exists()
    assert is_written(path)
    assert not old.exists()
    log.close()
    assert not is_written(path)


def test_logs_of_before_the_clock_was_put_back_make_room_first(tmp_path: Path) -> None:
    for number in range(1, 12):
        log = tmp_path / f"control-{number:04d}.rec"
        log.write_bytes(bytes(100_000))
        os.utime(log, (4e9 + number, 4e9 + number))
    folder = LogFolder(tmp_path, SMALL)
    for _ in range(3):
        with folder.open("control", "rec") as file:
            file.write(bytes(100_000))
    folder.trim()
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {f"control-{number:04d}.rec" for number in range(5, 15)}


def test_a_log_that_somebody_removes_while_it_is_written_is_followed_by_another(
    tmp_path: Path,
) -> None:
    folder = LogFolder(tmp_path, SMALL)
    states, bus = log_states(folder), log_bus(folder)
    for path in tmp_path.iterdir():
        path.unlink()
    for second in (2, 3):
        states.step([Notice(0, 6, "driving")], second * 10**9)
        bus._write("a frame\n")
    states.close()
    bus.close()
    assert {path.name for path in tmp_path.iterdir()} == {"can-0001.log", "robot-0001.mcap"}
    assert (tmp_path / "can-0001.log").read_text() == "a frame\n"
    assert is_complete(tmp_path / "robot-0001.mcap")


@WRITERS
def test_a_log_that_has_just_been_begun_is_not_taken_for_an_empty_one(
    tmp_path: Path, writer: Callable[[LogFolder], Any]
) -> None:
    log = writer(LogFolder(tmp_path, SMALL))
    (path,) = tmp_path.iterdir()
    os.truncate(path, 0)
    LogFolder(tmp_path, SMALL).remove_empty()
    assert path.exists()
    log.close()


def test_a_folder_that_takes_no_files_is_refused_and_one_that_does_stays_empty(
    tmp_path: Path,
) -> None:
    assert refusal(tmp_path) == ""
    assert not list(tmp_path.iterdir())
    assert refusal(Path("/proc")).startswith("/proc: cannot be written: ")


@pytest.mark.parametrize("how", [("--headless",), ("--lockstep",)])
def test_a_run_whose_record_cannot_be_written_does_not_begin(
    how: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("sim", *how, "--record", "/proc") == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("robotctl: /proc: cannot be written: ")
