"""What every CAN port does, on every bus there is: one suite over all twins."""

import contextlib
import socket
import subprocess
import sys
import time

import can
import pytest

import can_link
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.drivers.can.port import SocketPort
from robotctl.errors import LinkError
from robotctl.messages.control import BusState
from robotctl.runtime.clock import RealClock

WANTED = frozenset({0x001, 0x181, 0x281, 0x701})
VCAN = "vcan0"
DEADLINE_S = 5.0


class BusPeer:
    """Another node, through python-can."""

    def __init__(self, interface, channel):
        self.bus = can.Bus(interface=interface, channel=channel)

    def send(self, can_id, data):
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def receive(self, count):
        frames = []
        deadline = time.monotonic() + DEADLINE_S
        while len(frames) < count and time.monotonic() < deadline:
            message = self.bus.recv(0.05)
            if message is not None and not message.is_error_frame:
                frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def close(self):
        self.bus.shutdown()


class MemoryPeer:
    """Another node, in the same process."""

    def __init__(self, clock):
        self.clock = clock
        self.inbox = []
        self.port = MemoryPort(
            lambda can_id, data: self.inbox.append((can_id, data)), WANTED, CanConfig(), clock
        )

    def send(self, can_id, data):
        self.port.deliver(can_id, data, self.clock.now_ns())

    def receive(self, count):
        frames, self.inbox = self.inbox[:count], self.inbox[count:]
        return frames

    def close(self):
        """There is nothing to close."""


@pytest.fixture(scope="module")
def hub(tmp_path_factory):
    channel = str(tmp_path_factory.mktemp("simcan") / "bus.sock")
    process = subprocess.Popen(
        [sys.executable, "-m", "firmware_sim.bus", "--channel", channel],
        stderr=subprocess.PIPE,
        text=True,
    )
    line = process.stderr.readline()
    assert channel in line, line
    yield channel
    process.terminate()
    process.communicate(timeout=10)


@pytest.fixture(params=["memory", "simcan", "socketcan"])
def ends(request):
    clock = RealClock()
    if request.param == "memory":
        peer = MemoryPeer(clock)
        port = peer.port
    else:
        if request.param == "simcan":
            channel = request.getfixturevalue("hub")
        elif VCAN in {name for _, name in socket.if_nameindex()}:
            channel = VCAN
        else:
            pytest.skip(f"this kernel has no {VCAN}: run in tools/vcan-guest")
        peer = BusPeer(request.param, channel)
        port = SocketPort(CanConfig(request.param, channel), WANTED, clock)
    yield port, peer
    port.close()
    peer.close()


def drain(port, count):
    frames = []
    deadline = time.monotonic() + DEADLINE_S
    while len(frames) < count and time.monotonic() < deadline:
        frames += port.receive()
        time.sleep(0.001)
    return frames


def test_what_the_port_sends_reaches_the_other_node(ends):
    port, peer = ends
    sent = [(0x201, bytes(range(8))), (0x080, b""), (0x601, b"\x40\x18\x10\x01\x00\x00\x00\x00")]
    assert all(port.send(*frame) for frame in sent)
    assert peer.receive(3) == sent
    assert port.status().sent == 3


def test_what_the_other_node_sends_is_received_in_order(ends):
    port, peer = ends
    sent = [(0x281, bytes([n])) for n in range(20)] + [(0x701, b"\x05"), (0x001, b"")]
    for frame in sent:
        peer.send(*frame)
    assert [(f.arbitration_id, f.data) for f in drain(port, 22)] == sent
    status = port.status()
    assert (status.received, status.state) == (22, BusState.ERROR_ACTIVE)


def test_frames_that_are_not_wanted_stay_outside(ends):
    port, peer = ends
    peer.send(0x7FF, b"\x01")
    peer.send(0x182, b"\x02")
    peer.send(0x181, b"\x03")
    assert [(f.arbitration_id, f.data) for f in drain(port, 1)] == [(0x181, b"\x03")]
    assert port.receive() == []


def test_a_frame_of_ones_own_does_not_come_back(ends):
    port, peer = ends
    assert port.send(0x181, b"\x01")
    assert peer.receive(1) == [(0x181, b"\x01")]
    peer.send(0x281, b"\x02")
    assert [f.arbitration_id for f in drain(port, 1)] == [0x281]


def test_stamps_lie_on_the_monotonic_clock_and_do_not_fall(ends):
    port, peer = ends
    before_ns = time.monotonic_ns()
    for n in range(10):
        peer.send(0x181, bytes([n]))
    frames = drain(port, 10)
    after_ns = time.monotonic_ns()
    stamps = [f.stamp_ns for f in frames]
    assert len(stamps) == 10
    assert stamps == sorted(stamps)
    # the kernel maps its wall-clock stamps with two clock readings, so within a microsecond or so
    assert before_ns - 100_000 <= stamps[0]
    assert stamps[-1] <= after_ns


def test_receiving_from_a_silent_bus_does_not_wait(ends):
    port, _ = ends
    started_ns = time.monotonic_ns()
    for _ in range(100):
        assert port.receive() == []
    assert time.monotonic_ns() - started_ns < 1_000_000_000


def test_after_close_the_port_is_dead_and_silent(ends):
    port, peer = ends
    port.close()
    assert port.send(0x201, bytes(8)) is False
    assert port.status().send_failures == 1
    peer.send(0x181, b"\x01")
    assert port.receive() == []
    port.close()


def test_a_simulated_bus_that_dies_and_comes_back_is_found_again(tmp_path, clock):
    channel = str(tmp_path / "bus.sock")

    def start():
        process = subprocess.Popen(
            [sys.executable, "-m", "firmware_sim.bus", "--channel", channel, "--ack"],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert channel in process.stderr.readline()
        return process

    process = start()
    port = SocketPort(CanConfig("simcan", channel), WANTED, clock)
    assert port.send(0x201, bytes(8))
    process.kill()
    process.communicate(timeout=10)
    port.receive()
    assert port.send(0x201, bytes(8)) is False
    assert port.status().state is BusState.DOWN
    clock.sleep_until(clock.now_ns() + 500_000_000)
    assert port.receive() == []
    assert port.status().state is BusState.DOWN
    process = start()
    clock.sleep_until(clock.now_ns() + 500_000_000)
    port.receive()
    assert port.status().state is BusState.ERROR_ACTIVE
    assert port.send(0x201, bytes(8))
    port.close()
    process.terminate()
    process.communicate(timeout=10)


def test_a_socketcan_interface_that_is_not_there_is_named(clock):
    with pytest.raises(LinkError, match="socketcan robotctl-none"):
        SocketPort(CanConfig(channel="robotctl-none"), WANTED, clock)


@pytest.fixture
def own_interface():
    """A vcan interface of the test's own, which it may take down and delete."""
    name = "vcanport0"
    try:
        can_link.add_vcan(name)
    except OSError:
        pytest.skip("a vcan interface cannot be added here: run in tools/vcan-guest")
    can_link.set_link(name, up=True)
    yield name
    with contextlib.suppress(OSError):
        can_link.delete(name)


def test_an_interface_that_goes_down_or_away_and_comes_back_is_found_again(own_interface, clock):
    port = SocketPort(CanConfig("socketcan", own_interface), WANTED, clock)

    def state_after_retry():
        port.receive()
        clock.sleep_until(clock.now_ns() + 500_000_000)
        port.receive()
        port.receive()
        return port.status().state

    assert port.send(0x201, bytes(8))
    can_link.set_link(own_interface, up=False)
    assert state_after_retry() is BusState.DOWN
    assert port.send(0x201, bytes(8)) is False
    can_link.set_link(own_interface, up=True)
    assert state_after_retry() is BusState.ERROR_ACTIVE
    assert port.send(0x201, bytes(8))
    can_link.delete(own_interface)
    assert state_after_retry() is BusState.DOWN
    can_link.add_vcan(own_interface)
    can_link.set_link(own_interface, up=True)
    assert state_after_retry() is BusState.ERROR_ACTIVE
    assert port.send(0x201, bytes(8))
    port.close()
