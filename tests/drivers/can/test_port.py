"""The socket port against socket pairs and against sockets that fail in every way they can."""

import errno
import os
import socket
import struct
import time

import pytest

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.descriptor import opener
from robotctl.drivers.can.port import DRAIN_LIMIT, RETRY_NS, SocketPort
from robotctl.errors import LinkError
from robotctl.messages.control import BusState
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG
from robotctl.runtime.clock import VirtualClock

FRAME = struct.Struct("=IB3x8s")
ERROR = 0x20000000
CONFIG = CanConfig()
DEATHS = [
    errno.ENETDOWN,
    errno.ENODEV,
    errno.ENXIO,
    errno.ENOTCONN,
    errno.ECONNRESET,
    errno.EPIPE,
    errno.EBADF,
    errno.EIO,
]


class FailingSocket:
    """A socket whose next calls raise what the test put there."""

    def __init__(self):
        self.failures = {"send": [], "receive": [], "pending": 0}
        self.sent = []
        self.closed = False

    def _maybe_fail(self, call):
        if self.failures[call]:
            code = self.failures[call].pop(0)
            raise BlockingIOError(code, "") if code == errno.EAGAIN else OSError(code, "")

    def send(self, data):
        self._maybe_fail("send")
        self.sent.append(data)
        return len(data)

    def recv_into(self, buffer):
        self._maybe_fail("receive")
        raise BlockingIOError(errno.EAGAIN, "")

    def recvmsg_into(self, buffers, size):
        return (self.recv_into(buffers[0]), [], 0, None)

    def getsockopt(self, level, option):
        return self.failures["pending"]

    def close(self):
        self.closed = True


class FakeDescriptor:
    def __init__(self, sock, kernel=False):
        self.socket = sock
        self.kernel = kernel
        self.waits = lambda _: True

    def close(self):
        self.socket.close()


class Rig:
    """A port whose bus the test opens, breaks and refuses."""

    def __init__(self, clock, kernel=False):
        self.clock = clock
        self.opened = []
        self.refusal = None
        self.kernel = kernel
        self.port = SocketPort(CONFIG, {0x181}, clock, self.open)

    def open(self):
        if self.refusal is not None:
            raise self.refusal
        self.opened.append(FailingSocket())
        return FakeDescriptor(self.opened[-1], self.kernel)

    def later(self, duration_ns):
        self.clock.sleep_until(self.clock.now_ns() + duration_ns)


@pytest.fixture(params=[False, True], ids=["plain", "kernel"])
def rig(clock, request):
    return Rig(clock, request.param)


@pytest.mark.parametrize("code", [errno.EAGAIN, errno.ENOBUFS])
def test_a_full_queue_refuses_the_frame_and_leaves_the_bus_up(rig, code):
    rig.opened[0].failures["send"] = [code]
    assert rig.port.send(0x201, bytes(8)) is False
    assert rig.port.send(0x201, bytes(8)) is True
    status = rig.port.status()
    assert (status.state, status.send_failures, status.sent) == (BusState.ERROR_ACTIVE, 1, 1)


@pytest.mark.parametrize("code", DEATHS)
@pytest.mark.parametrize("call", ["send", "receive"])
def test_any_other_error_takes_the_port_down_without_an_exception(rig, call, code):
    rig.opened[0].failures[call] = [code]
    rig.port.send(0x201, bytes(8))
    assert rig.port.receive() == []
    assert rig.port.status().state is BusState.DOWN
    assert rig.opened[0].closed
    assert rig.port.send(0x201, bytes(8)) is False
    assert rig.port.status().send_failures == (2 if call == "send" else 1)


def test_a_bus_that_came_back_is_opened_again_after_half_a_second(rig):
    rig.opened[0].failures["receive"] = [errno.ENETDOWN]
    rig.port.receive()
    rig.later(RETRY_NS - 1)
    rig.port.receive()
    assert len(rig.opened) == 1
    rig.later(1)
    rig.port.receive()
    assert len(rig.opened) == 2
    assert rig.port.status().state is BusState.ERROR_ACTIVE
    assert rig.port.send(0x201, bytes(8)) is True


def test_sending_on_a_dead_bus_does_not_put_off_the_next_attempt_to_open_it(rig):
    rig.opened[0].failures["receive"] = [errno.ENETDOWN]
    rig.port.receive()
    for _ in range(100):
        rig.later(RETRY_NS // 100)
        rig.port.send(0x201, bytes(8))
    rig.port.receive()
    assert len(rig.opened) == 2


@pytest.mark.parametrize(
    "refusal", [OSError(errno.ENODEV, "no such device"), ValueError("no channel")]
)
def test_an_attempt_that_fails_is_repeated_each_half_second(rig, refusal):
    rig.opened[0].failures["receive"] = [errno.ENETDOWN]
    rig.port.receive()
    rig.refusal = refusal
    for _ in range(3):
        rig.later(RETRY_NS)
        assert rig.port.receive() == []
        assert rig.port.status().state is BusState.DOWN
    rig.refusal = None
    rig.port.receive()
    assert len(rig.opened) == 1
    rig.later(RETRY_NS)
    rig.port.receive()
    assert len(rig.opened) == 2


def test_an_interface_that_is_down_can_be_bound_but_does_not_count_as_up(clock):
    rig = Rig(clock)
    rig.opened[0].failures["receive"] = [errno.ENETDOWN]
    rig.port.receive()
    make = rig.open

    def open_bound_but_down():
        descriptor = make()
        descriptor.socket.failures["pending"] = errno.ENETDOWN
        return descriptor

    rig.port._open = open_bound_but_down
    rig.later(RETRY_NS)
    rig.port.receive()
    assert rig.port.status().state is BusState.DOWN
    assert rig.opened[-1].closed


def test_after_close_nothing_is_sent_received_or_opened(rig):
    rig.port.close()
    rig.port.close()
    rig.later(10 * RETRY_NS)
    assert rig.port.receive() == []
    assert rig.port.send(0x201, b"") is False
    assert len(rig.opened) == 1


@pytest.mark.parametrize("refusal", [OSError(errno.ENODEV, "No such device"), ValueError("what")])
def test_a_bus_that_cannot_be_opened_at_the_start_says_how_it_comes_up(clock, refusal):
    def refuse():
        raise refusal

    with pytest.raises(LinkError, match=r"socketcan can0: cannot be opened.*ip link set can0 up"):
        SocketPort(CONFIG, {0x181}, clock, refuse)


def test_a_virtual_bus_is_added_and_has_no_bit_rate(clock):
    def refuse():
        raise OSError(errno.ENODEV, "No such device")

    with pytest.raises(LinkError) as refused:
        SocketPort(CanConfig(channel="vcan3"), {0x181}, clock, refuse)
    assert "ip link add dev vcan3 type vcan; sudo ip link set vcan3 up`" in str(refused.value)
    assert "bitrate" not in str(refused.value)


def test_a_network_device_that_does_not_exist_is_a_link_error(clock):
    with pytest.raises(LinkError, match="nocan9: cannot be opened"):
        SocketPort(CanConfig(channel="nocan9"), {0x181}, clock)


def test_a_simulated_bus_that_does_not_run_is_a_link_error(clock, tmp_path):
    config = CanConfig(interface="simcan", channel=str(tmp_path / "none.sock"))
    with pytest.raises(LinkError, match="no hub at"):
        SocketPort(config, {0x181}, clock)


class Pair:
    """A port on one end of a socket pair, the test on the other."""

    def __init__(self, clock):
        self.far, near = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        near.setblocking(False)
        self.port = SocketPort(CONFIG, {0x181, 0x281}, clock, lambda: FakeDescriptor(near))

    def put(self, can_id, data=b"", stamp_ns=None):
        frame = FRAME.pack(can_id, len(data), data)
        self.far.send(frame if stamp_ns is None else frame + struct.pack("=Q", stamp_ns))

    def close(self):
        self.port.close()
        self.far.close()


@pytest.fixture
def pair(clock):
    pair = Pair(clock)
    yield pair
    pair.close()


def test_a_sent_frame_is_a_struct_can_frame(pair):
    assert pair.port.send(0x201, b"\x01\x02\x03")
    assert pair.far.recv(64) == struct.pack("=IBBBB8s", 0x201, 3, 0, 0, 0, b"\x01\x02\x03")


@pytest.mark.parametrize(("data_bitrate", "flags"), [(1_000_000, 4), (5_000_000, 5)])
def test_a_frame_of_can_fd_switches_where_the_bus_has_a_higher_data_bit_rate(
    clock, data_bitrate, flags
):
    far, near = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    config = CanConfig(data_bitrate=data_bitrate)
    port = SocketPort(config, [], clock, lambda: FakeDescriptor(near))
    assert port.send(0x1F001 | EXTENDED_FLAG | FD_FLAG, bytes(range(12)))
    sent = far.recv(128)
    header = struct.pack("=IBBBB", 0x8001F001, 12, flags, 0, 0)
    assert sent == header + bytes(range(12)) + bytes(52)
    port.close()
    far.close()


def test_received_frames_come_in_order_with_their_data_length(pair):
    pair.put(0x181, b"\x01")
    pair.put(0x281, b"")
    pair.put(0x181, bytes(range(8)))
    frames = pair.port.receive()
    assert [(f.arbitration_id, f.data) for f in frames] == [
        (0x181, b"\x01"),
        (0x281, b""),
        (0x181, bytes(range(8))),
    ]
    assert pair.port.status().received == 3
    assert pair.port.receive() == []


def test_the_stamp_of_a_frame_is_that_of_the_simulated_bus(pair, clock):
    pair.put(0x181, b"\x01", stamp_ns=clock.now_ns() - 12_345)
    assert [f.stamp_ns for f in pair.port.receive()] == [clock.now_ns() - 12_345]


@pytest.mark.parametrize("error_ns", [1, 10**12])
def test_a_stamp_of_the_future_is_replaced_by_the_present(pair, clock, error_ns):
    clock.sleep_until(10**14)
    pair.put(0x181, b"\x01", stamp_ns=clock.now_ns() + error_ns)
    assert [f.stamp_ns for f in pair.port.receive()] == [clock.now_ns()]


@pytest.mark.parametrize("can_id", [0x201, 0x182, 0x181 | 0x80000000, 0x181 | 0x40000000])
def test_unwanted_extended_and_remote_frames_are_left_out(pair, can_id):
    pair.put(can_id, b"\x01")
    assert pair.port.receive() == []
    assert pair.port.status().received == 0


def test_an_error_frame_counts_and_moves_the_state(pair):
    pair.put(ERROR | 0x004, bytes((0, 0x20, 0, 0, 0, 0, 130, 0)))
    pair.put(0x181, b"\x01")
    assert len(pair.port.receive()) == 1
    status = pair.port.status()
    assert (status.state, status.error_frames) == (BusState.ERROR_PASSIVE, 1)
    pair.put(ERROR | 0x040, bytes(8))
    pair.port.receive()
    assert pair.port.status().state is BusState.BUS_OFF
    pair.put(ERROR | 0x100, bytes(8))
    pair.port.receive()
    assert pair.port.status().state is BusState.ERROR_ACTIVE


def test_a_fragment_is_no_frame(pair):
    pair.far.send(b"\x81\x01\x00")
    pair.put(0x181, b"\x01")
    assert len(pair.port.receive()) == 1
    assert pair.port.status().error_frames == 1


def test_a_babbling_node_cannot_hold_the_loop(pair):
    for _ in range(2):
        for _ in range(DRAIN_LIMIT // 2):
            pair.put(0x181, bytes(8))
        for _ in range(DRAIN_LIMIT // 2 + 5):
            pair.put(0x181, bytes(8))
        assert len(pair.port.receive()) == DRAIN_LIMIT
        assert len(pair.port.receive()) == 5


def test_a_hub_that_hangs_up_takes_the_port_down(pair):
    pair.put(0x181, b"\x01")
    pair.far.close()
    assert len(pair.port.receive()) == 1
    assert pair.port.status().state is BusState.DOWN


def test_the_load_is_the_share_of_the_last_second(pair, clock):
    pair.port.receive()
    for _ in range(10):
        clock.sleep_until(clock.now_ns() + 100_000_000)
        for _ in range(20):
            pair.put(0x181, bytes(8))
            pair.port.send(0x201, bytes(8))
            pair.far.recv(64)
        pair.port.receive()
    assert pair.port.status().load == pytest.approx(400 * 123 / 1e6)


def realtime_stamped(monotonic_ns):
    """What SO_TIMESTAMPNS gives for a frame received at a monotonic time."""
    realtime_ns = monotonic_ns + time.time_ns() - time.monotonic_ns()
    data = struct.pack("@ll", *divmod(realtime_ns, 1_000_000_000))
    return [(socket.SOL_SOCKET, 35, data)]


class StampedSocket(FailingSocket):
    def __init__(self):
        super().__init__()
        self.frames = []

    def recvmsg_into(self, buffers, size):
        if not self.frames:
            raise BlockingIOError(errno.EAGAIN, "")
        buffers[0][:16] = FRAME.pack(0x181, 1, b"\x07")
        return 16, self.frames.pop(0), 0, None


class PresentClock(VirtualClock):
    def now_ns(self):
        return time.monotonic_ns()


@pytest.fixture
def stamped():
    sock = StampedSocket()
    port = SocketPort(CONFIG, {0x181}, PresentClock(), lambda: FakeDescriptor(sock, kernel=True))
    return port, sock


def test_kernel_stamps_are_mapped_to_the_monotonic_clock(stamped):
    port, sock = stamped
    received_ns = time.monotonic_ns() - 1_500_000
    sock.frames = [realtime_stamped(received_ns)]
    [frame] = port.receive()
    assert abs(frame.stamp_ns - received_ns) < 500_000


def test_where_the_wall_clock_was_set_the_present_takes_the_place_of_the_stamp(
    stamped, monkeypatch
):
    port, sock = stamped
    before_ns = time.monotonic_ns()
    sock.frames = [realtime_stamped(before_ns)]
    real = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() + 3_600_000_000_000)
    [frame] = port.receive()
    assert before_ns <= frame.stamp_ns <= time.monotonic_ns()
    sock.frames = [realtime_stamped(before_ns)]
    [frame] = port.receive()
    assert abs(frame.stamp_ns - before_ns) < 500_000


@pytest.mark.parametrize("waited_s", [9.9, 10.1, 60.0])
def test_frames_that_waited_while_the_process_stood_stay_old(stamped, pair, clock, waited_s):
    port, sock = stamped
    waited_ns = round(waited_s * 1e9)
    received_ns = time.monotonic_ns() - waited_ns
    sock.frames = [realtime_stamped(received_ns)]
    [frame] = port.receive()
    assert abs(frame.stamp_ns - received_ns) < 500_000
    clock.sleep_until(10**14)
    pair.put(0x181, b"\x01", stamp_ns=clock.now_ns() - waited_ns)
    [frame] = pair.port.receive()
    assert frame.stamp_ns == clock.now_ns() - waited_ns


def test_a_clock_that_is_set_back_while_frames_are_taken_makes_none_of_them_old(
    stamped, monkeypatch
):
    port, sock = stamped
    real, back_ns = time.time_ns, 3_600_000_000_000
    received_ns = time.monotonic_ns()
    set_back = [(socket.SOL_SOCKET, 35, struct.pack("@ll", *divmod(real() - back_ns, 10**9)))]

    class Clock:
        """Set back behind the first look at it."""

        looks = 0

        def __call__(self):
            self.looks += 1
            return real() - (back_ns if self.looks > 1 else 0)

    sock.frames = [set_back]
    monkeypatch.setattr(time, "time_ns", Clock())
    [frame] = port.receive()
    assert received_ns <= frame.stamp_ns <= time.monotonic_ns()


def test_a_frame_without_a_kernel_stamp_gets_the_present(stamped):
    port, sock = stamped
    before_ns = time.monotonic_ns()
    sock.frames = [[]]
    [frame] = port.receive()
    assert before_ns <= frame.stamp_ns <= time.monotonic_ns()


def test_the_opener_closes_a_bus_that_has_no_socket(monkeypatch, tmp_path):
    read, write = os.pipe()

    class PipeBus:
        closed = False

        def fileno(self):
            return read

        def shutdown(self):
            PipeBus.closed = True

    monkeypatch.setattr("can.Bus", lambda **_: PipeBus())
    with pytest.raises(OSError, match="Socket operation on non-socket"):
        opener(CanConfig(interface="simcan", channel="x"), {1})()
    assert PipeBus.closed
    os.close(read)
    os.close(write)
