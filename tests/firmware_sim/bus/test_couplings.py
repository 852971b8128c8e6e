"""One contract for the three ways onto the bus: in process, through a hub, over a CAN interface.

The interface is stood in for by a pair of datagram sockets, which pass `can_frame`s and
`canfd_frame`s whole as a raw CAN socket does. All run under virtual time, on a bus of CAN FD.
"""

import socket
import struct

import pytest

from firmware_sim.bus.bits import frame_bits
from firmware_sim.bus.bridge import Bridge
from firmware_sim.bus.core import Bus
from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import Destroy
from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    EXTENDED_FLAG,
    FD_FLAG,
    FD_LENGTHS,
    REMOTE_FLAG,
)
from firmware_sim.bus.hub import Hub

MILLISECOND = 1_000_000
ERROR = 0x20000000
DATA_BITRATE = 5_000_000
BRS, ESI, FDF = 1, 2, 4


def packed(can_id, data):
    """A frame as struct can_frame or canfd_frame of linux/can.h."""
    if can_id < 1 << 32:
        return struct.pack("=IBBBB8s", can_id, len(data), 0, 0, 0, data)
    flags = FDF | (BRS if can_id & BIT_RATE_SWITCH_FLAG else 0)
    return struct.pack("=IBBBB64s", can_id & 0xFFFFFFFF, len(data), flags, 0, 0, data)


def unpacked(message):
    """Id with the simulator's flags, and data, of such a frame."""
    can_id, length, flags = struct.unpack_from("=IBB", message)
    if len(message) >= 72:
        assert flags & FDF
        assert not flags & ESI
        can_id |= FD_FLAG | (BIT_RATE_SWITCH_FLAG if flags & BRS else 0)
    return can_id, message[8 : 8 + length]


class InProcess:
    """The host is a port of the bus."""

    def __init__(self):
        self.bus = Bus(data_bitrate=DATA_BITRATE)
        self._heard = []
        self._waiting = []
        self._port = self.bus.attach("host", self._heard.append, errors=True)

    def send(self, can_id, data=b""):
        self._waiting.append((can_id, data))
        self.service()

    def service(self):
        while self._waiting and self._port.room:
            assert self._port.send(*self._waiting.pop(0))

    def heard(self):
        found = [(frame.arbitration_id, frame.data) for frame in self._heard]
        self._heard.clear()
        return found

    def leave(self):
        self._port.detach()

    def close(self):
        pass


class ThroughHub:
    """The host is a client of a hub."""

    def __init__(self, raw_client):
        self.bus = Bus(data_bitrate=DATA_BITRATE)
        self._hub = Hub(self.bus, "contract")
        self._client = raw_client(self._hub, options=2 | 8)

    def send(self, can_id, data=b""):
        self._client.socket.send(packed(can_id, data))

    def service(self):
        self._hub.service(0)

    def heard(self):
        messages = self._client.raw_messages()
        assert {len(message) for message in messages} <= {24, 80}
        return [unpacked(message[:-8]) for message in messages]

    def leave(self):
        self._client.close()

    def close(self):
        self._hub.close()


class OverInterface:
    """The host is on the far side of a bridged interface."""

    def __init__(self):
        self.bus = Bus(data_bitrate=DATA_BITRATE)
        near, self._far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._far.setblocking(False)
        self._bridge = Bridge(self.bus, near, "host")

    def send(self, can_id, data=b""):
        self._far.send(packed(can_id, data))

    def service(self):
        self._bridge.service(0)

    def heard(self):
        found = []
        while True:
            try:
                message = self._far.recv(100)
            except BlockingIOError:
                return found
            assert len(message) in {16, 72}
            found.append(unpacked(message))

    def leave(self):
        self._bridge.close()

    def close(self):
        self._far.close()
        self._bridge.close()


@pytest.fixture(params=["in process", "hub", "interface"])
def world(request, raw_client):
    made = {
        "in process": InProcess,
        "hub": lambda: ThroughHub(raw_client),
        "interface": OverInterface,
    }[request.param]()
    yield made
    made.close()


def drive(world, name="drive", **options):
    got = []
    return world.bus.attach(name, got.append, **options), got


def run(world, duration_ns=MILLISECOND):
    """Serve, then let time pass, and serve again, as an owner's loop does."""
    world.service()
    world.bus.advance(world.bus.now_ns + duration_ns)
    world.service()


FRAMES = [
    (0x201, b"\x01\x02\x03"),
    (0x080, b""),
    (0x1ABCDEF0 | EXTENDED_FLAG, bytes(range(8))),
    (0x181 | REMOTE_FLAG, bytes(5)),
    (0x001 | EXTENDED_FLAG, b"\xff"),
    (0x201 | FD_FLAG, b"\x01\x02\x03"),
    (0x1ABCDEF0 | EXTENDED_FLAG | FD_FLAG | BIT_RATE_SWITCH_FLAG, bytes(range(64))),
    *((0x123 | FD_FLAG | BIT_RATE_SWITCH_FLAG, bytes(length)) for length in FD_LENGTHS),
]


def test_frames_of_the_host_reach_the_nodes_whole_and_in_order(world):
    _, got = drive(world)
    for can_id, data in FRAMES:
        world.send(can_id, data)
    run(world, 5 * MILLISECOND)
    assert [(frame.arbitration_id, frame.data) for frame in got] == FRAMES


def test_frames_of_the_nodes_reach_the_host_whole_and_in_order(world):
    port, _ = drive(world)
    for can_id, data in FRAMES:
        port.send(can_id, data)
    run(world, 5 * MILLISECOND)
    assert world.heard() == FRAMES


def test_the_host_does_not_hear_itself(world):
    drive(world)
    world.send(0x201, b"x")
    run(world)
    assert world.heard() == []


def test_a_frame_arrives_at_its_completion_and_not_before(world):
    port, _ = drive(world)
    port.send(0x181, b"12345678")
    end_ns = world.bus.now_ns + 1000 * frame_bits(0x181, b"12345678")
    world.bus.advance(end_ns - 1)
    assert world.heard() == []
    world.bus.advance(end_ns)
    assert world.heard() == [(0x181, b"12345678")]


def test_host_and_nodes_compete_for_the_bus(world):
    drive(world, "listener")
    port, got = drive(world)
    port.send(0x300)
    world.send(0x200)
    world.send(0x400)
    run(world)
    assert [frame.arbitration_id for frame in got] == [0x200, 0x400]
    assert world.heard() == [(0x300, b"")]
    assert port.statistics.arbitration_lost == 1


def test_the_host_acknowledges(world):
    port, _ = drive(world)
    port.send(0x181)
    run(world)
    assert port.statistics.sent == 1
    assert not world.bus.statistics.errors


def test_the_host_is_told_of_errors_on_the_wire(world):
    drive(world)
    world.bus.inject(Destroy(error=BusError.BIT_ERROR, count=1))
    world.send(0x201, b"x")
    run(world)
    ((can_id, data),) = world.heard()
    assert can_id == ERROR | 0x288  # CNT, BUSERROR, PROT
    assert data[6] == 8


def test_an_unheard_host_becomes_passive_and_is_told(world):
    world.send(0x201, b"x")
    run(world, 20 * MILLISECOND)
    states = [data[1] for can_id, data in world.heard() if can_id & 0x004]
    assert states == [0x08, 0x20]


def test_a_host_that_left_is_no_node_any_more(world):
    port, got = drive(world)
    world.leave()
    if isinstance(world, ThroughHub):
        world.service()
    port.send(0x181)
    world.bus.advance(world.bus.now_ns + 10 * MILLISECOND)
    assert [entry.name for entry in world.bus.ports] == ["drive"]
    assert port.counters.tec == 128
    assert got == []


def test_more_frames_than_the_queue_takes_wait_and_arrive_in_order(world):
    _, got = drive(world)
    for number in range(100):
        world.send(0x201, bytes([number]))
    for _ in range(40):
        run(world)
    assert [frame.data[0] for frame in got] == list(range(100))
