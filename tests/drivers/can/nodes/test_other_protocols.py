"""Frames of other protocols on the robot's bus: the robot takes none of them for its own.

A recorded run of the firmware is played to the robot once as it was, and again among frames of all
kinds, most of them forged from the recorded ones: the same identifier and data with a 29-bit
identifier, as a remote request, as CAN FD. The socket has no kernel's filter here.
"""

import random
import socket
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.simulation import Simulation
from robotctl.app.processes.robot import node_parameters
from robotctl.config.robot_file import find_file, load_robot
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.drivers.can.port import SocketPort
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.ports import EXTENDED_FLAG, FD_LENGTHS, REMOTE_FLAG
from robotctl.runtime.clock import VirtualClock
from tests.native_frames import native_parts, native_robot

PERIOD_NS = 5_000_000
START_NS = 1_000_000_000
TICKS = 120
"""As long as commissioning takes, so that SDO answers are among what is forged."""
BUSES = [CanConfig(), CanConfig(data_bitrate=5_000_000)]
COMMAND = ActuatorCommand(enable=False, brake=True)


class FakeDescriptor:
    kernel = False

    def __init__(self, sock):
        self.socket = sock
        self.waits = lambda _: True

    def close(self):
        self.socket.close()


class Player:
    """A robot on one end of a socket pair, whose other end plays what the bus carried."""

    def __init__(self, codec, parameters, config):
        self.far, near = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        near.setblocking(False)
        self.far.setblocking(False)
        self.clock = VirtualClock(START_NS)
        parts = native_parts(codec, parameters)
        ids = parts.identifiers("")
        port = SocketPort(config, ids, self.clock, lambda: FakeDescriptor(near))
        self.robot = native_robot(port, parts)

    def play(self, ticks):
        """Feedback of each tick."""
        feedback = []
        for messages in ticks:
            now_ns = self.clock.now_ns() + PERIOD_NS
            self.clock.sleep_until(now_ns)
            for message in messages:
                self.far.send(message)
            feedback.append(self.robot.receive(now_ns))
            self.robot.send(COMMAND, now_ns)
            while True:
                try:
                    self.far.recv(128)
                except BlockingIOError:
                    break
        return feedback

    def close(self):
        self.robot.close()
        self.far.close()


def classic(can_id, data, stamp_ns=None):
    message = struct.pack("=IB3x8s", can_id, len(data), data)
    return message if stamp_ns is None else message + struct.pack("=q", stamp_ns)


def fd(can_id, data, flags=5):
    size = next(each for each in FD_LENGTHS if each >= len(data))
    return struct.pack("=IBB2x64s", can_id, size, flags, data)


class RecordingPort(MemoryPort):
    """Keeps what it hands out, tick by tick."""

    def receive(self):
        frames = super().receive()
        self.ticks.append(frames)
        return frames


@pytest.fixture(scope="module")
def parameters():
    return node_parameters(load_robot(find_file("diff_drive")))


@pytest.fixture(scope="module")
def recorded(codec, parameters):
    """The frames that the host heard in each tick."""
    clock = VirtualClock(START_NS)
    simulation = Simulation(
        find_file("diff_drive"), find_file("empty_room", "worlds"), seed=1, start_ns=START_NS
    )
    parts = native_parts(codec, parameters)
    ids = parts.identifiers("")
    port = RecordingPort(lambda *_: False, ids, CanConfig(), clock)
    port.transmit = simulation.bus.attach("host", port.deliver, accept=ids).send
    port.ticks = []
    robot = native_robot(port, parts)
    for tick in range(1, TICKS + 1):
        now_ns = START_NS + tick * PERIOD_NS
        simulation.advance(now_ns)
        clock.sleep_until(now_ns)
        robot.receive(now_ns)
        robot.send(COMMAND, now_ns)
    return port.ticks


@pytest.fixture(scope="module")
def expected(recorded, codec, parameters):
    """Feedback of each tick without others on the bus."""
    player = Player(codec, parameters, CanConfig())
    feedback = player.play([[classic(*frame) for frame in tick] for tick in recorded])
    player.close()
    return feedback


def forged(rng, can_id, data):
    """A recorded frame in every other guise, and under 29-bit identifiers that have its own."""
    yield classic(can_id | EXTENDED_FLAG, data)
    yield classic(can_id << 18 | rng.getrandbits(18) | EXTENDED_FLAG, data)
    yield classic(rng.getrandbits(18) << 11 | can_id | EXTENDED_FLAG, data)
    yield classic(can_id | REMOTE_FLAG, data)
    yield classic(can_id | EXTENDED_FLAG | REMOTE_FLAG, data)
    yield fd(can_id, data)
    yield fd(can_id, data, flags=4)
    yield fd(can_id | EXTENDED_FLAG, data)
    yield fd(can_id, data + rng.randbytes(48))


def strange(rng):
    """Frames of any other protocol."""
    yield classic(rng.getrandbits(29) | EXTENDED_FLAG, rng.randbytes(rng.randrange(9)))
    yield classic(rng.getrandbits(11) | REMOTE_FLAG, rng.randbytes(rng.randrange(9)))
    yield fd(rng.getrandbits(29) | EXTENDED_FLAG, rng.randbytes(rng.randrange(65)))
    yield fd(rng.getrandbits(11), rng.randbytes(rng.randrange(65)))


@pytest.mark.parametrize("config", BUSES, ids=["classic", "fd"])
@settings(max_examples=10, deadline=None)
@given(rng=st.randoms(use_true_random=False))
def test_frames_of_other_protocols_never_change_the_feedback(
    codec, parameters, recorded, expected, config, rng
):
    assert expected[-1].nodes
    assert not [node.problem for node in expected[-1].nodes if node.problem]
    rng = random.Random(rng.getrandbits(64))
    ticks = []
    for tick in recorded:
        messages = [classic(*frame) for frame in tick]
        others = [each for can_id, data, _ in tick for each in forged(rng, can_id, data)]
        for message in (*rng.sample(others, min(len(others), 9)), *strange(rng)):
            messages.insert(rng.randint(0, len(messages)), message)
        ticks.append(messages)
    player = Player(codec, parameters, config)
    feedback = player.play(ticks)
    player.close()
    assert feedback == expected
