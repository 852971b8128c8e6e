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
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, FD_LENGTHS, REMOTE_FLAG
from robotctl.runtime.clock import RealClock

FD_ID, FD_LONG_ID = 0x105 | FD_FLAG, 0x1F001 | EXTENDED_FLAG | FD_FLAG
LONG_ID, REMOTE_ID = 0x1234 | EXTENDED_FLAG, 0x702 | REMOTE_FLAG
WANTED = frozenset({0x001, 0x181, 0x281, 0x701, FD_ID, FD_LONG_ID, LONG_ID, REMOTE_ID})
DATA_BITRATE = 5_000_000
VCAN = "vcan0"
DEADLINE_S = 5.0


def message_of(can_id, data, switch=True):
    """A frame with an identifier as in `Frame`, for python-can."""
    extended, remote = bool(can_id & EXTENDED_FLAG), bool(can_id & REMOTE_FLAG)
    fd = bool(can_id & FD_FLAG)
    return can.Message(
        arbitration_id=can_id & (0x1FFFFFFF if extended else 0x7FF),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=fd and switch,
        dlc=len(data),
        data=None if remote else data,
    )


def frame_of(message):
    """Identifier as in `Frame`, and data, of a frame from python-can."""
    can_id = message.arbitration_id
    for flag, is_set in (
        (EXTENDED_FLAG, message.is_extended_id),
        (REMOTE_FLAG, message.is_remote_frame),
        (FD_FLAG, message.is_fd),
    ):
        can_id |= flag if is_set else 0
    return can_id, bytes(message.dlc) if message.is_remote_frame else bytes(message.data)


class BusPeer:
    """Another node, through python-can."""

    def __init__(self, interface, channel, fd=False):
        self.bus = can.Bus(interface=interface, channel=channel, fd=fd)

    def send(self, can_id, data, switch=True):
        self.bus.send(message_of(can_id, data, switch))

    def messages(self, count):
        found = []
        deadline = time.monotonic() + DEADLINE_S
        while len(found) < count and time.monotonic() < deadline:
            message = self.bus.recv(0.05)
            if message is not None and not message.is_error_frame:
                found.append(message)
        return found

    def receive(self, count):
        return [frame_of(message) for message in self.messages(count)]

    def close(self):
        self.bus.shutdown()


class MemoryPeer:
    """Another node, in the same process."""

    def __init__(self, config, clock):
        self.clock = clock
        self.inbox = []
        self.port = MemoryPort(
            lambda can_id, data: self.inbox.append((can_id, data)), WANTED, config, clock
        )

    def send(self, can_id, data, switch=True):
        self.port.deliver((can_id, data, self.clock.now_ns()))

    def receive(self, count):
        frames, self.inbox = self.inbox[:count], self.inbox[count:]
        return frames

    def close(self):
        """There is nothing to close."""


def run_hub(channel, *options):
    process = subprocess.Popen(
        [sys.executable, "-m", "firmware_sim.bus", "--channel", channel, *options],
        stderr=subprocess.PIPE,
        text=True,
    )
    line = process.stderr.readline()
    assert channel in line, line
    return process


@pytest.fixture(scope="module")
def hub(tmp_path_factory):
    channel = str(tmp_path_factory.mktemp("simcan") / "bus.sock")
    process = run_hub(channel)
    yield channel
    process.terminate()
    process.communicate(timeout=10)


@pytest.fixture(scope="module")
def fd_hub(tmp_path_factory):
    channel = str(tmp_path_factory.mktemp("simcan") / "fd.sock")
    process = run_hub(channel, "--data-bitrate", str(DATA_BITRATE))
    yield channel
    process.terminate()
    process.communicate(timeout=10)


def open_ends(request, data_bitrate=0):
    """A port and another node on a bus of the kind that the fixture's parameter names."""
    clock = RealClock()
    if request.param == "memory":
        peer = MemoryPeer(CanConfig(data_bitrate=data_bitrate), clock)
        return peer.port, peer
    if request.param == "simcan":
        channel = request.getfixturevalue("fd_hub" if data_bitrate else "hub")
    elif VCAN in {name for _, name in socket.if_nameindex()}:
        channel = VCAN
    else:
        pytest.skip(f"this kernel has no {VCAN}: run in tools/vcan-guest")
    peer = BusPeer(request.param, channel, fd=data_bitrate > 0)
    config = CanConfig(request.param, channel, data_bitrate=data_bitrate)
    return SocketPort(config, WANTED, clock), peer


@pytest.fixture(params=["memory", "simcan", "socketcan"])
def ends(request):
    port, peer = open_ends(request)
    yield port, peer
    port.close()
    peer.close()


@pytest.fixture(params=["memory", "simcan", "socketcan"])
def fd_ends(request):
    port, peer = open_ends(request, DATA_BITRATE)
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
    """Among them those that have the low eleven bits of a wanted one, of any other kind."""
    port, peer = ends
    for can_id in (0x7FF, 0x182, 0x181 | EXTENDED_FLAG, 0x181 | REMOTE_FLAG, 0x1234 & 0x7FF):
        peer.send(can_id, b"\x01")
    peer.send(0x181, b"\x03")
    assert [(f.arbitration_id, f.data) for f in drain(port, 1)] == [(0x181, b"\x03")]
    assert port.receive() == []


OTHERS = [(LONG_ID, bytes(range(8))), (REMOTE_ID, bytes(1)), (0x181, b"x"), (REMOTE_ID, b"")]
FD_FRAMES = [
    *OTHERS,
    *((FD_ID, bytes(range(size))) for size in FD_LENGTHS),
    (FD_LONG_ID, bytes(range(64))),
]


@pytest.mark.parametrize("kind", ["memory", "simcan"])
def test_a_port_without_a_filter_receives_all_frames(kind, request):
    clock = RealClock()
    sent = [(0x7FF, b"\x01"), (LONG_ID + 1, b"\x02"), (0x123 | REMOTE_FLAG, bytes(3)),
            (0x456 | FD_FLAG, bytes(12))]  # fmt: skip
    config = CanConfig(
        "simcan",
        request.getfixturevalue("fd_hub") if kind == "simcan" else "x",
        data_bitrate=DATA_BITRATE,
    )
    if kind == "memory":
        port = MemoryPort(lambda *_: None, None, config, clock)
        for can_id, data in sent:
            port.deliver((can_id, data, clock.now_ns()))
        port.deliver((0x2000_0004, bytes(8), clock.now_ns()))  # an error frame is none
    else:
        port, peer = SocketPort(config, None, clock), BusPeer("simcan", config.channel, fd=True)
        for can_id, data in sent:
            peer.send(can_id, data)
    frames = drain(port, len(sent))
    assert [(frame.arbitration_id, frame.data) for frame in frames] == sent
    assert not port.receive()
    port.close()
    if kind == "simcan":
        peer.close()


def test_29_bit_identifiers_and_remote_requests_pass_both_ways(ends):
    port, peer = ends
    assert all(port.send(*frame) for frame in OTHERS)
    assert peer.receive(len(OTHERS)) == OTHERS
    for frame in OTHERS:
        peer.send(*frame)
    assert [(f.arbitration_id, f.data) for f in drain(port, len(OTHERS))] == OTHERS
    assert (port.status().sent, port.status().received) == (len(OTHERS), len(OTHERS))


def test_frames_of_can_fd_pass_both_ways_with_bit_rate_switch_and_received_without(fd_ends):
    port, peer = fd_ends
    assert all(port.send(*frame) for frame in FD_FRAMES)
    if isinstance(peer, BusPeer):
        messages = peer.messages(len(FD_FRAMES))
        assert [frame_of(message) for message in messages] == FD_FRAMES
        assert all(message.bitrate_switch == message.is_fd for message in messages)
    else:
        assert peer.receive(len(FD_FRAMES)) == FD_FRAMES
    for frame in FD_FRAMES:
        peer.send(*frame)
        peer.send(*frame, switch=False)
    expected = [frame for frame in FD_FRAMES for _ in range(2)]
    assert [(f.arbitration_id, f.data) for f in drain(port, len(expected))] == expected


def test_frames_of_can_fd_are_told_from_classic_ones_of_the_same_identifier(fd_ends):
    port, peer = fd_ends
    peer.send(0x181 | FD_FLAG, b"\x01")
    peer.send(FD_ID & 0x7FF, b"\x02")
    peer.send(0x181 | EXTENDED_FLAG | FD_FLAG, b"\x03")
    peer.send(FD_ID, b"\x04")
    assert [(f.arbitration_id, f.data) for f in drain(port, 1)] == [(FD_ID, b"\x04")]
    assert port.receive() == []


@pytest.mark.parametrize("frame", [(FD_ID, b""), (FD_ID, bytes(64)), (LONG_ID, bytes(9))])
def test_a_classic_bus_refuses_frames_of_can_fd_and_stays_up(ends, frame):
    port, peer = ends
    assert port.send(*frame) is False
    assert (port.status().send_failures, port.status().sent) == (1, 0)
    assert port.send(0x201, b"x")
    assert peer.receive(1) == [(0x201, b"x")]


@pytest.mark.parametrize("size", [9, 13, 63, 65])
def test_a_frame_of_no_length_of_can_fd_is_refused_since_padding_is_the_protocols(fd_ends, size):
    port, peer = fd_ends
    assert port.send(FD_ID, bytes(size)) is False
    assert port.status().send_failures == 1
    assert port.send(FD_ID, bytes(64))
    assert peer.receive(1) == [(FD_ID, bytes(64))]


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

    process = run_hub(channel, "--ack")
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
    process = run_hub(channel, "--ack")
    clock.sleep_until(clock.now_ns() + 500_000_000)
    port.receive()
    assert port.status().state is BusState.ERROR_ACTIVE
    assert port.send(0x201, bytes(8))
    port.close()
    process.terminate()
    process.communicate(timeout=10)


def test_can_fd_on_a_simulated_bus_without_it_is_refused_at_the_start(hub, clock):
    with pytest.raises(LinkError, match="classic CAN, not CAN FD"):
        SocketPort(CanConfig("simcan", hub, data_bitrate=DATA_BITRATE), WANTED, clock)


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


def test_an_interface_without_can_fd_is_refused_for_it_and_carries_classic_frames(
    own_interface, clock
):
    can_link.set_link(own_interface, up=False)
    can_link.set_mtu(own_interface, 16)
    can_link.set_link(own_interface, up=True)
    with pytest.raises(LinkError, match=r"classic frames only, not CAN FD; .* mtu 72"):
        SocketPort(CanConfig("socketcan", own_interface, data_bitrate=DATA_BITRATE), WANTED, clock)
    port = SocketPort(CanConfig("socketcan", own_interface), WANTED, clock)
    assert port.send(FD_ID, bytes(12)) is False
    assert port.send(0x201, bytes(8))
    assert port.status().state is BusState.ERROR_ACTIVE
    port.close()


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
