"""The recorder beside the real processes of a robot: kills, emergency stops, orderly ends."""

import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import msgspec
import pytest
import zmq
from mcap.reader import make_reader
from pymavlink import mavutil

from firmware_sim.bus.channels import running_channels
from robotctl.app.processes.progress import StoredProgress, progress_file
from robotctl.app.supervision.stack import CONTROL, RECORDER, Stack, StackError
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.mcap.recovery import is_complete
from robotctl.messages.control import Notice
from robotctl.runtime.ipc.topics import Endpoints, Subscriber, endpoint_directory, ring_path
from robotctl.workbench.replay.replay import replay_file

DEADLINE_S = 40.0


def wait(condition: Callable[[], Any], what: str) -> Any:
    deadline_s = time.monotonic() + DEADLINE_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)
    return found


@pytest.fixture(scope="module")
def channel() -> Iterator[str]:
    name = f"recorder-{os.getpid()}"
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", name, "--ack"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as hub:
        try:
            wait(lambda: name in running_channels(), "the bus is there")
            yield name
        finally:
            hub.terminate()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def options(channel: str, folder: Path) -> StackOptions:
    return StackOptions(
        "robot",
        str(find_file("diff_drive").resolve()),
        ('can.interface="simcan"', f'can.channel="{channel}"', "mavlink.link=[]"),
        record=str(folder / "logs"),
        flights=str(folder / "flights"),
        state=str(folder / "state"),
        run="test",
    )


@pytest.fixture
def stack(options: StackOptions) -> Iterator[Stack]:
    with contextlib.closing(Stack(options)) as made:
        yield made


def until(stack: Stack, condition: Callable[[], Any], what: str) -> Any:
    def look() -> Any:
        stack.watch()
        return condition()

    return wait(look, what)


def size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def log_times_s(path: Path) -> list[float]:
    with path.open("rb") as file:
        return [message.log_time / 1e9 for _, _, message in make_reader(file).iter_messages()]


def test_logs_records_and_dumps_outlive_the_kill_of_any_process(stack: Stack, folder: Path) -> None:
    logs, flights = folder / "logs", folder / "flights"
    until(stack, lambda: stack.ready, "ready")
    until(stack, lambda: size(logs / "robot-0001.mcap") > 20_000, "seconds are logged")

    stack.emergency_stop()
    until(stack, lambda: list(flights.glob("fault-*.rec")), "the emergency stop is dumped")

    killed_s = time.time()
    os.kill(stack.pid(RECORDER), signal.SIGKILL)
    until(stack, lambda: stack.starts(RECORDER) == 2, "the recorder is started again")
    until(stack, lambda: size(logs / "robot-0002.mcap") > 2_000, "it logs on")
    assert is_complete(logs / "robot-0001.mcap")
    assert killed_s - log_times_s(logs / "robot-0001.mcap")[-1] < 1.5

    os.kill(stack.pid(CONTROL), signal.SIGKILL)
    (crash,) = until(stack, lambda: list(flights.glob("crash-*.rec")), "the crash is dumped")
    until(stack, lambda: stack.starts(CONTROL) == 2, "control is started again")
    until(stack, lambda: size(logs / "control-0003.rec") > 60_000, "and recorded again")
    stack.close()

    assert not ring_path("robot").exists()
    dumps = [*flights.glob("fault-*.rec"), crash]
    for file in (*dumps, *logs.glob("control-*.rec")):
        result = replay_file(file).result
        assert result.difference is None, file
        assert result.gaps == 0, file
        assert result.agreed > 50, file
    times_s = [time_s for path in sorted(logs.glob("robot-*.mcap")) for time_s in log_times_s(path)]
    gaps_s = [after - before for before, after in itertools.pairwise(times_s)]
    assert max(gaps_s) < 8.0
    with can.io.CanutilsLogReader(logs / "can-0001.log") as reader:
        assert len(list(reader)) > 100
    assert json.loads((folder / "state" / "progress.json").read_text().split("\n")[1])["run"]


def test_a_second_robot_that_would_overwrite_the_state_of_the_first_is_refused(
    stack: Stack,
    options: StackOptions,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    until(stack, lambda: stack.ready, "ready")
    bus = ('can.interface="simcan"', 'can.channel="of-its-own"', "mavlink.link=[]")
    with tempfile.TemporaryDirectory(dir="/tmp") as short:  # paths of sockets have little room
        monkeypatch.setenv("XDG_RUNTIME_DIR", short)
        second = Stack(msgspec.structs.replace(options, overrides=bus, run="second"))
        with contextlib.closing(second), pytest.raises(StackError, match="control process did not"):
            until(second, lambda: second.ready, "refused")
    assert f"{folder / 'state'}: another robotctl of this computer has it" in capfd.readouterr().err


def test_a_ground_station_that_comes_late_hears_what_the_run_before_left(
    stack: Stack, options: StackOptions, folder: Path
) -> None:
    state = folder / "state" / "progress.json"
    until(stack, lambda: size(folder / "logs" / "robot-0001.mcap") > 20_000, "seconds are logged")
    until(stack, state.exists, "progress is saved")
    for module in (RECORDER, *(each for each in stack.modules if each != RECORDER)):
        os.kill(stack.pid(module), signal.SIGKILL)
    stack.close()
    state.write_bytes(state.read_bytes()[:-3])

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    link = f'mavlink.link=[{{url="tcpin:{address}"}}]'
    after = msgspec.structs.replace(options, overrides=(*options.overrides, link))
    with contextlib.closing(Stack(after)) as stack:
        until(stack, lambda: stack.ready, "ready")
        ground_station = mavutil.mavlink_connection(f"tcp:{address}", source_system=255)
        said = ""

        def heard(*words: str) -> bool:
            nonlocal said
            ground_station.mav.heartbeat_send(mavutil.mavlink.MAV_TYPE_GCS, 8, 0, 0, 0)
            while (text := ground_station.recv_match(type="STATUSTEXT")) is not None:
                said += text.text
            return all(each in said for each in words)

        with contextlib.closing(ground_station):
            left = ("progress.json: damaged", "0001.mcap: was cut, completed", "/crash-")
            until(stack, lambda: heard(*left), "all that the run before left is said")
        assert all(words in said for words in left)


def test_a_damaged_odometer_is_set_aside_and_said_and_the_one_before_goes_on(
    channel: str, folder: Path
) -> None:
    state = folder / "state"
    file = progress_file(state)
    file.save(StoredProgress("old", 1000.0, 0.0, 0.0, 0.0))
    file.save(StoredProgress("old", 1001.0, 0.0, 0.0, 0.0))
    path = state / "progress.json"
    path.write_bytes(path.read_bytes()[:-3])
    options = StackOptions(
        "robot",
        str(find_file("diff_drive").resolve()),
        ('can.interface="simcan"', f'can.channel="{channel}"', "mavlink.link=[]"),
        state=str(state),
        run="new",
    )
    with subprocess.Popen(options.command(CONTROL)) as process, zmq.Context() as context:
        address = Endpoints(endpoint_directory("robot")).control_state
        listener = Subscriber[Notice](context, (address,), Notice)
        (notice,) = wait(listener.receive, "a notice")
        listener.close()
        process.terminate()
    assert f"{path}: damaged" in notice.text
    assert "progress.json.damaged-1" in notice.text
    assert file.load()[0] == StoredProgress("old", 1000.0, 0.0, 0.0, 0.0)
