"""The IMU's node on the simulated bus: when it sends, how often, and what it lets be written."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import pytest
from e2e import p01

from firmware_sim.config.config import load_robot
from firmware_sim.nodes import wire
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
MS = 1_000_000
START, STOP, PRE_OPERATIONAL, RESET = 1, 2, 128, 129
RANGE_ABORT = 0x06090030


class Host:
    """Somebody on the bus of a robot with an IMU."""

    def __init__(self) -> None:
        robot = load_robot(CONFIGS / "diff_drive.toml", {"imu.enabled": True})
        self.simulation = Simulation(robot, CONFIGS / "worlds" / "empty_room.toml")
        self.heard = []
        ids = (wire.IMU_GYRO, wire.IMU_ACCELEROMETER, 0x584, 0x704)
        self.port = self.simulation.bus.attach("host", self.heard.append, accept=ids)
        self.run(20)

    def run(self, milliseconds: int) -> None:
        self.simulation.advance(self.simulation.now_ns + milliseconds * MS)

    def nmt(self, command: int) -> None:
        self.port.send(0x000, bytes((command, 4)))
        self.run(1)
        self.heard.clear()

    def frames(self, identifier: int) -> list:
        return [frame for frame in self.heard if frame.arbitration_id == identifier]

    def sdo(self, index: int, value: int | None = None) -> tuple[int, int]:
        """Read an object, or write two bytes; return command and value, or abort code."""
        command = 0x40 if value is None else 0x2B
        self.heard.clear()
        self.port.send(0x604, struct.pack("<BHBI", command, index, 0, value or 0))
        self.run(5)
        (answer,) = self.frames(0x584)
        command, _, _, found = struct.unpack("<BHBI", answer.data)
        return command, found


@pytest.fixture
def host() -> Host:
    return Host()


def test_it_boots_fourth_and_says_nothing_before_it_is_started(host: Host) -> None:
    assert [frame.data for frame in host.frames(0x704)] == [b"\0"]
    host.run(300)
    assert not host.frames(wire.IMU_GYRO)
    assert host.frames(0x704)[-1].data == b"\x7f"


@pytest.mark.parametrize("period_ms", [5, 20, 50])
def test_started_it_sends_both_frames_each_period(host: Host, period_ms: int) -> None:
    assert host.sdo(0x2400, period_ms)[0] == 0x60
    host.nmt(START)
    host.run(10 * period_ms)
    for identifier in (wire.IMU_GYRO, wire.IMU_ACCELEROMETER):
        stamps = [frame.stamp_ns for frame in host.frames(identifier)]
        assert len(stamps) in (9, 10)
        gaps = [b - a for a, b in itertools.pairwise(stamps)]
        assert all(abs(gap - period_ms * MS) < MS for gap in gaps)


def test_both_frames_are_protected(host: Host) -> None:
    host.nmt(START)
    host.run(400)
    for identifier in (wire.IMU_GYRO, wire.IMU_ACCELEROMETER):
        frames = host.frames(identifier)
        for number, frame in enumerate(frames):
            assert frame.data[1] & 15 == number % 15
            data = bytearray(frame.data)
            p01.e2e_p01_protect(data, 0xA000 + identifier, length=8, increment_counter=False)
            assert bytes(data) == frame.data


@pytest.mark.parametrize("command", [STOP, PRE_OPERATIONAL, RESET])
def test_out_of_operation_it_is_silent(host: Host, command: int) -> None:
    host.nmt(START)
    host.run(100)
    host.nmt(command)
    host.run(200)
    assert not host.frames(wire.IMU_GYRO)
    assert not host.frames(wire.IMU_ACCELEROMETER)


@pytest.mark.parametrize("period_ms", [0, 4, 101])
def test_a_period_out_of_range_is_refused(host: Host, period_ms: int) -> None:
    assert host.sdo(0x2400, period_ms) == (0x80, RANGE_ABORT)
    assert host.sdo(0x2400)[1] == 20


def test_it_speaks_the_wire_of_the_dbc(host: Host) -> None:
    assert host.sdo(0x2001)[1] == wire.PROTOCOL_VERSION
