"""The bus log: the same lines as candump's, read back by python-can, complete and rotated."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bus.channels import running_channels
from firmware_sim.bus.log import log_line
from robotctl.drivers.can.candump import candump_line
from robotctl.drivers.can.config import CanConfig
from robotctl.logs.logs import BusLog
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder

DEADLINE_S = 20.0
IDS = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF).map(lambda each: each | 0x80000000),
    st.integers(0, 0x7FF).map(lambda each: each | 0x40000000),
    st.integers(0, 0x1FF).map(lambda each: each | 0x20000000),
)


@given(IDS, st.binary(max_size=8), st.integers(0, 4 * 10**18))
def test_a_line_is_that_of_the_simulators_own_log(can_id: int, data: bytes, time_ns: int) -> None:
    assert candump_line(can_id, data, time_ns // 1000, "can0") == log_line(
        (can_id, data, time_ns), "can0"
    )


@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 2 * 10**15))
def test_python_can_reads_a_line_back(can_id: int, data: bytes, time_us: int) -> None:
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"candump-{os.getpid()}.log"
    try:
        folder.write_text(candump_line(can_id, data, time_us, "can0"))
        with can.io.CanutilsLogReader(folder) as reader:
            (message,) = reader
    finally:
        folder.unlink()
    assert (message.arbitration_id, bytes(message.data)) == (can_id, data)
    assert message.is_extended_id is False
    assert message.channel == "can0"
    assert message.timestamp == pytest.approx(time_us / 1e6, abs=1e-6)


@contextmanager
def running_hub() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    name = f"candump-{os.getpid()}"
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", name, "--ack"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            deadline_s = time.monotonic() + DEADLINE_S
            while name not in running_channels():
                assert time.monotonic() < deadline_s
                time.sleep(0.01)
            yield process, name
        finally:
            process.terminate()


@pytest.fixture
def hub() -> Iterator[str]:
    with running_hub() as (_, name):
        yield name


def test_the_last_frames_before_the_bus_goes_are_logged(tmp_path: Path) -> None:
    with running_hub() as (process, name):
        config = CanConfig(interface="simcan", channel=name)
        log = BusLog(LogFolder(tmp_path, LogConfig()), [config], 0)
        log.step(0)
        with (
            can.Bus(interface="simcan", channel=name) as sender,
            can.Bus(interface="simcan", channel=name) as listener,
        ):
            for number in range(20):
                sender.send(can.Message(arbitration_id=number, is_extended_id=False))
            for number in range(20):
                heard = listener.recv(DEADLINE_S)
                assert heard is not None
                assert heard.arbitration_id == number
        process.terminate()
        process.wait()
    assert log.step(1) == ()
    (note,) = log.step(2)
    assert note == f"the log cannot read bus {name}: the bus has hung up"
    log.close()
    with can.io.CanutilsLogReader(tmp_path / "can-0001.log") as reader:
        assert [each.arbitration_id for each in reader] == list(range(20))


def test_every_frame_of_the_bus_is_logged_over_files_and_the_log_waits_for_its_bus(
    tmp_path: Path, hub: str
) -> None:
    config = CanConfig(interface="simcan", channel=hub)
    missing = CanConfig(interface="simcan", channel=f"{hub}-missing")
    nothing = BusLog(LogFolder(tmp_path, LogConfig()), [missing], 0)
    (note,) = nothing.step(0)
    assert f"cannot read bus {hub}-missing" in note
    assert [nothing.step(now) for now in (1, 2_000_000_000)] == [(), ()]

    log = BusLog(LogFolder(tmp_path, LogConfig(0.004, 1.0)), [config], 0)
    log.step(0)
    sent = [(0x100 + number % 7, bytes((number & 0xFF, number >> 8))) for number in range(400)]
    with can.Bus(interface="simcan", channel=hub) as bus:
        deadline_s = time.monotonic() + DEADLINE_S
        got: list[tuple[int, bytes]] = []
        pending = list(sent)
        while len(got) < len(sent):
            assert time.monotonic() < deadline_s, f"{len(got)} of {len(sent)}"
            if pending:
                can_id, data = pending.pop(0)
                bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
                time.sleep(0.0003)
            if len(pending) % 20 == 0:
                assert log.step(1) == ()
                got = []
                for path in sorted(tmp_path.glob("can-*.log")):
                    with can.io.CanutilsLogReader(path) as reader:
                        got += [(each.arbitration_id, bytes(each.data)) for each in reader]
    assert got == sent
    assert len(list(tmp_path.glob("can-*.log"))) > 2
    log.close()
