"""The bus log: the same lines as candump's, read back by python-can, complete and rotated."""

import os
import struct
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
from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    ERROR_STATE_FLAG,
    EXTENDED_FLAG,
    FD_FLAG,
    FD_FLAGS_SHIFT,
    FD_LENGTHS,
    REMOTE_FLAG,
    Frame,
)
from firmware_sim.bus.log import log_line
from robotctl.drivers.can.candump import candump_line
from robotctl.drivers.can.config import CanConfig
from robotctl.logs.logs import BusLog
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder

DEADLINE_S = 20.0
PLAIN = st.one_of(
    st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda each: each | EXTENDED_FLAG)
)
CLASSIC = st.tuples(
    st.one_of(
        PLAIN,
        PLAIN.map(lambda each: each | REMOTE_FLAG),
        st.integers(0, 0x1FF).map(lambda each: each | 0x20000080),
    ),
    st.binary(max_size=8),
)
FD = st.tuples(
    st.builds(
        lambda plain, flags: plain | FD_FLAG | flags << FD_FLAGS_SHIFT, PLAIN, st.integers(0, 3)
    ),
    st.sampled_from(FD_LENGTHS).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
)


def packed(can_id: int, data: bytes) -> bytes:
    """A frame as SocketCAN has it, of an identifier with the flags of the simulator."""
    if can_id <= 0xFFFFFFFF:
        return struct.pack("=IB3x8s", can_id, len(data), data)
    flags = 4 | can_id >> FD_FLAGS_SHIFT
    return struct.pack("=IBB2x64s", can_id & 0xFFFFFFFF, len(data), flags, data)


@given(st.one_of(CLASSIC, FD), st.integers(0, 4 * 10**18))
def test_a_line_is_that_of_the_simulators_own_log(frame: tuple[int, bytes], time_ns: int) -> None:
    can_id, data = frame
    assert candump_line(packed(can_id, data), time_ns // 1000, "can0") == log_line(
        Frame(can_id, data, time_ns), "can0"
    )


@given(st.one_of(CLASSIC, FD), st.integers(0, 2 * 10**15))
def test_python_can_reads_a_line_back(frame: tuple[int, bytes], time_us: int) -> None:
    can_id, data = frame
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"candump-{os.getpid()}.log"
    try:
        folder.write_text(candump_line(packed(can_id, data), time_us, "can0"))
        with can.io.CanutilsLogReader(folder) as reader:
            (message,) = reader
    finally:
        folder.unlink()
    if can_id & 0x20000000:
        assert message.is_error_frame
        return
    extended, remote = bool(can_id & EXTENDED_FLAG), bool(can_id & REMOTE_FLAG)
    sent = can.Message(
        timestamp=message.timestamp,
        arbitration_id=can_id & (0x1FFFFFFF if extended else 0x7FF),
        is_extended_id=extended,
        is_remote_frame=remote,
        dlc=len(data),
        data=None if remote else data,
        is_fd=can_id > 0xFFFFFFFF,
        bitrate_switch=bool(can_id & BIT_RATE_SWITCH_FLAG),
        error_state_indicator=bool(can_id & ERROR_STATE_FLAG),
        channel="can0",
    )
    assert message.equals(sent)
    assert message.timestamp == pytest.approx(time_us / 1e6, abs=1e-6)


def test_lines_are_those_that_can_utils_documents() -> None:
    """`candump -L` of can-utils: `##` and the flags of a frame of CAN FD before its data."""
    time_us = 1_436_509_052_249_713
    frames = [
        (packed(0x044, bytes.fromhex("2A366C2BBA")), "044#2A366C2BBA"),
        (packed(0x1F334455 | EXTENDED_FLAG, bytes.fromhex("112233")), "1F334455#112233"),
        (packed(0x123 | FD_FLAG, b""), "123##0"),
        (packed(0x213 | FD_FLAG | BIT_RATE_SWITCH_FLAG, b"\x31\x12"), "213##13112"),
        (packed(0x5A1 | REMOTE_FLAG, bytes(8)), "5A1#R8"),
    ]
    for message, text in frames:
        line = candump_line(message, time_us, "vcan0")
        assert line == f"(1436509052.249713) vcan0 {text}\n"


@contextmanager
def running_hub(suffix: str = "", *options: str) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    name = f"candump-{os.getpid()}{suffix}"
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", name, "--ack", *options]
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


def test_frames_of_all_kinds_on_two_buses_are_one_log_in_the_order_of_time(tmp_path: Path) -> None:
    sent = [
        can.Message(arbitration_id=0x181, data=b"12", is_extended_id=False),
        can.Message(arbitration_id=0x12345678, data=bytes(8)),
        can.Message(arbitration_id=0x701, is_remote_frame=True, dlc=1, is_extended_id=False),
        can.Message(arbitration_id=0x105, data=bytes(64), is_fd=True, bitrate_switch=True),
        can.Message(arbitration_id=0x105, data=bytes(48), is_fd=True, is_extended_id=False),
    ]
    with running_hub("a", "--data-bitrate", "5000000") as (_, fast), running_hub("b") as (_, slow):
        configs = [
            CanConfig(interface="simcan", channel=fast, data_bitrate=5_000_000, name="fast"),
            CanConfig(interface="simcan", channel=slow, name="slow"),
        ]
        log = BusLog(LogFolder(tmp_path, LogConfig()), configs, 0)
        assert log.step(0) == ()
        with (
            can.Bus(interface="simcan", channel=fast, fd=True) as one,
            can.Bus(interface="simcan", channel=fast, fd=True) as heard_one,
            can.Bus(interface="simcan", channel=slow) as other,
            can.Bus(interface="simcan", channel=slow) as heard_other,
        ):
            for message in sent:
                one.send(message)
                assert heard_one.recv(DEADLINE_S) is not None
                if not message.is_fd:
                    other.send(message)
                    assert heard_other.recv(DEADLINE_S) is not None
            log.step(1)
        log.close()
    with can.io.CanutilsLogReader(tmp_path / "can-0001.log") as reader:
        logged = list(reader)
    stamps = [message.timestamp for message in logged]
    assert stamps == sorted(stamps)
    for channel, expected in (
        (fast, sent),
        (slow, [message for message in sent if not message.is_fd]),
    ):
        found = [message for message in logged if message.channel == channel]
        for message, wanted in zip(found, expected, strict=True):
            assert message.equals(wanted, timestamp_delta=None, check_channel=False)
