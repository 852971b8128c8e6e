"""Frames of every kind on the kernel's own CAN: what its filters pass, and what becomes of it."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

import can
import pytest

import can_link
from firmware_sim.bus.bridge import Bridge
from firmware_sim.bus.core import Bus
from robotctl.app.processes.can_tap import BusTap
from robotctl.app.processes.robot import open_ports
from robotctl.config.robot_file import find_file, load_robot
from robotctl.drivers.can.candump import CandumpReader
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.descriptor import opener
from robotctl.drivers.can.port import SocketPort
from robotctl.errors import LinkError
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, REMOTE_FLAG
from robotctl.runtime.clock import RealClock

T = TypeVar("T")
INTERFACE = "vcan0"
FD = CanConfig(channel=INTERFACE, data_bitrate=5_000_000)
DEADLINE_S = 5.0


def wanted(bus: str) -> list[int]:
    """Return what a robot listens to on a bus: one kind of frame."""
    return [{"main": 0x181, "sensors": 0x182 | FD_FLAG}[bus]]


def message(number: int, data: bytes = b"", **options: object) -> can.Message:
    options.setdefault("is_extended_id", number > 0x7FF)
    return can.Message(arbitration_id=number, data=data, **options)


KINDS = {
    0x181: message(0x181, b"1"),
    0x181 | EXTENDED_FLAG: message(0x181, b"2", is_extended_id=True),
    0x1ABCDE81 | EXTENDED_FLAG: message(0x1ABCDE81, bytes(8)),
    0x181 | REMOTE_FLAG: message(0x181, is_remote_frame=True, dlc=2),
    0x181 | FD_FLAG: message(0x181, bytes(64), is_fd=True, bitrate_switch=True),
    0x1ABCDE81 | EXTENDED_FLAG | FD_FLAG: message(0x1ABCDE81, bytes(12), is_fd=True),
}
"""One frame of each kind, all with the same low eleven bits, by the identifier of `Frame`."""


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    with can.Bus(interface="socketcan", channel=INTERFACE, fd=True) as bus:
        yield bus


@pytest.fixture
def second_interface() -> Iterator[str]:
    name = "vcankinds1"
    can_link.add_vcan(name)
    can_link.set_link(name, up=True)
    yield name
    with contextlib.suppress(OSError):
        can_link.delete(name)


def collect(take: Callable[[], list[T]], count: int) -> list[T]:
    """What `take` returns until there are `count` of it: the kernel delivers soon, not at once."""
    found: list[T] = []
    deadline_s = time.monotonic() + DEADLINE_S
    while len(found) < count and time.monotonic() < deadline_s:
        found += take()
        time.sleep(0.001)
    return found


def received(port: SocketPort, count: int) -> list[tuple[int, bytes]]:
    frames = collect(port.receive, count)
    return [(frame.arbitration_id, frame.data) for frame in frames]


@pytest.mark.parametrize("wanted", KINDS, ids=hex)
def test_a_port_gets_the_one_kind_that_it_asked_for(other: can.BusABC, wanted: int) -> None:
    port = SocketPort(FD, [wanted], RealClock())
    for each in KINDS.values():
        other.send(each)
    other.send(KINDS[wanted])
    data = bytes(KINDS[wanted].dlc) if wanted & REMOTE_FLAG else bytes(KINDS[wanted].data)
    assert received(port, 2) == [(wanted, data)] * 2
    assert port.receive() == []
    port.close()


def test_frames_of_other_kinds_stay_in_the_kernel(other: can.BusABC) -> None:
    """Of the classic socket of a robot without CAN FD only its own eleven bits come out."""
    descriptor = opener(CanConfig(channel=INTERFACE), [0x181])()
    for each in (*KINDS.values(), KINDS[0x181]):
        other.send(each)

    def sizes() -> list[int]:
        try:
            return [len(descriptor.socket.recv(128))]
        except BlockingIOError:
            return []

    try:
        assert collect(sizes, 2) == [16, 16]
        assert sizes() == []
    finally:
        descriptor.close()


@pytest.mark.parametrize("sent", KINDS, ids=hex)
def test_what_a_port_sends_is_what_python_can_receives(other: can.BusABC, sent: int) -> None:
    port = SocketPort(FD, [], RealClock())
    expected = KINDS[sent]
    data = bytes(expected.dlc) if sent & REMOTE_FLAG else bytes(expected.data)
    assert port.send(sent, data)
    heard = other.recv(DEADLINE_S)
    assert heard is not None
    assert heard.bitrate_switch == bool(sent & FD_FLAG)
    heard.bitrate_switch = expected.bitrate_switch
    assert heard.equals(expected, timestamp_delta=None, check_channel=False, check_direction=False)
    port.close()


def test_log_and_tap_see_every_kind(other: can.BusABC) -> None:
    reader, tap = CandumpReader(FD, 0), BusTap(FD)
    assert tap.open()
    for each in KINDS.values():
        other.send(each)
    texts = [line.split()[2] for line in collect(reader.read, len(KINDS))]
    assert texts == [
        "181#31",
        "00000181#32",
        "1ABCDE81#0000000000000000",
        "181#R2",
        f"181##1{'00' * 64}",
        f"1ABCDE81##0{'00' * 12}",
    ]
    assert collect(tap.receive, len(KINDS) - 1) == [
        (can_id, bytes(each.data)) for can_id, each in KINDS.items() if not can_id & REMOTE_FLAG
    ]
    reader.close()
    tap.close()


def test_a_bridge_passes_every_kind_both_ways(other: can.BusABC) -> None:
    bus = Bus(data_bitrate=5_000_000)
    heard: list[tuple[int, bytes]] = []
    node = bus.attach("node", lambda frame: heard.append((frame.arbitration_id, frame.data)))
    bridge = Bridge.open(bus, INTERFACE)
    for each in KINDS.values():
        other.send(each)

    def pass_on() -> list[tuple[int, bytes]]:
        bridge.service(0)
        bus.advance(bus.now_ns + 10_000_000)
        new = heard.copy()
        heard.clear()
        return new

    for can_id, data in collect(pass_on, len(KINDS)):
        assert node.send(can_id, data)
    bus.advance(bus.now_ns + 10_000_000)
    for expected in KINDS.values():
        back = other.recv(DEADLINE_S)
        assert back is not None
        assert back.equals(
            expected, timestamp_delta=None, check_channel=False, check_direction=False
        )
    bridge.close()


def test_a_bridge_of_can_fd_needs_an_interface_that_carries_it(second_interface: str) -> None:
    can_link.set_link(second_interface, up=False)
    can_link.set_mtu(second_interface, 16)
    can_link.set_link(second_interface, up=True)
    with pytest.raises(OSError, match="mtu 72"):
        Bridge.open(Bus(data_bitrate=5_000_000), second_interface)
    Bridge.open(Bus(), second_interface).close()


def test_a_robot_with_two_buses_has_a_port_on_each(
    other: can.BusABC, second_interface: str
) -> None:
    robot = load_robot(find_file("diff_drive"))
    buses = (
        CanConfig(channel=INTERFACE),
        CanConfig(channel=second_interface, name="sensors", data_bitrate=2_000_000),
    )
    ports = open_ports(dataclasses.replace(robot, can=buses), wanted, RealClock())
    assert list(ports) == ["main", "sensors"]
    with can.Bus(interface="socketcan", channel=second_interface, fd=True) as far:
        other.send(message(0x181, b"1"))
        far.send(message(0x182, bytes(16), is_fd=True))
        assert received(ports["main"], 1) == [(0x181, b"1")]
        assert received(ports["sensors"], 1) == [(0x182 | FD_FLAG, bytes(16))]
        assert ports["sensors"].send(0x182 | FD_FLAG, bytes(8))
        assert not ports["main"].send(0x182 | FD_FLAG, bytes(8))
        heard = far.recv(DEADLINE_S)
        assert heard is not None
        assert heard.is_fd
    for port in ports.values():
        port.close()


def test_a_second_bus_that_is_missing_is_named_and_the_first_is_released() -> None:
    robot = load_robot(find_file("diff_drive"))
    buses = (CanConfig(channel=INTERFACE), CanConfig(channel="vcanmissing", name="sensors"))
    with pytest.raises(LinkError, match="socketcan vcanmissing: cannot be opened"):
        open_ports(dataclasses.replace(robot, can=buses), wanted, RealClock())
