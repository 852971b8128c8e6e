"""Frames of every kind on the simulated nodes' bus: none crashes a node, and no other protocol's
changes what a node does."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    EXTENDED_FLAG,
    FD_FLAG,
    FD_LENGTHS,
    REMOTE_FLAG,
)
from firmware_sim.config.config import load_robot
from firmware_sim.simulation import Simulation
from robotctl.config.robot_file import find_file

MS = 1_000_000
OVERRIDES = {"can.data_bitrate": 5_000_000, "imu.enabled": True}


def make():
    robot = load_robot(find_file("diff_drive"), OVERRIDES)
    simulation = Simulation(robot, find_file("empty_room", "worlds"), seed=1)
    heard = []
    host = simulation.bus.attach("host", heard.append, queue_limit=1000)
    simulation.advance(20 * MS)
    return simulation, host, heard


@pytest.fixture(scope="module")
def shared():
    return make()


@settings(max_examples=60, deadline=None)
@given(rng=st.randoms(use_true_random=False))
def test_no_frame_crashes_a_node(shared, rng):
    """Those that nodes listen to among them, with data of any length."""
    simulation, host, heard = shared
    rng = random.Random(rng.getrandbits(64))
    listened = sorted({each for node in simulation.nodes for each in node.arbitration_ids})
    for _ in range(20):
        plain = rng.choice([*listened, rng.getrandbits(11)])
        size = rng.randrange(9)
        can_id = rng.choice(
            [plain, plain, plain | REMOTE_FLAG, rng.getrandbits(29) | EXTENDED_FLAG]
        )
        if rng.random() < 0.2:
            can_id |= FD_FLAG | rng.choice([0, BIT_RATE_SWITCH_FLAG])
            can_id &= ~REMOTE_FLAG
            size = rng.choice(FD_LENGTHS)
        host.send(can_id, rng.randbytes(size))
        simulation.advance(simulation.now_ns + rng.choice([0, MS, 5 * MS]))
    # After a reset of all, every node boots and answers a question.
    simulation.advance(simulation.now_ns + 20 * MS)
    host.send(0x000, bytes((129, 0)))
    simulation.advance(simulation.now_ns + 50 * MS)
    heard.clear()
    for node in simulation.nodes:
        host.send(0x600 + node.node_id, bytes((0x40, 0x18, 0x10, 1, 0, 0, 0, 0)))
    simulation.advance(simulation.now_ns + 20 * MS)
    answers = {frame.arbitration_id for frame in heard if frame.data[:4] == b"\x43\x18\x10\x01"}
    assert answers == {0x580 + node.node_id for node in simulation.nodes}


def test_frames_of_other_protocols_change_nothing_that_a_node_sends():
    """Between two runs only the times of frames differ: the bus is busier."""

    def run(disturbed):
        simulation, host, heard = make()
        rng = random.Random(5)
        sent = []
        script = [
            (0x000, bytes((1, 0))),
            (0x601, bytes((0x40, 0x00, 0x20, 0, 0, 0, 0, 0))),
            (0x601, bytes((0x2B, 0x00, 0x20, 0, 120, 0, 0, 0))),
            (0x080, b""),
            (0x001, b"\x01"),
        ]
        for can_id, data in [*script, *[(0x080, b"")] * 20]:
            if disturbed:
                for other in (
                    can_id | EXTENDED_FLAG,
                    can_id << 18 | EXTENDED_FLAG,
                    can_id | REMOTE_FLAG,
                    can_id | FD_FLAG,
                    can_id | FD_FLAG | BIT_RATE_SWITCH_FLAG,
                ):
                    host.send(other, data)
                host.send(rng.getrandbits(29) | EXTENDED_FLAG, rng.randbytes(8))
            host.send(can_id, data)
            simulation.advance(simulation.now_ns + 10 * MS)
            sent.append({(frame.arbitration_id, frame.data) for frame in heard if stable(frame)})
            heard.clear()
        return sent, [node.state for node in simulation.nodes], simulation.truth().bus_errors

    def stable(frame):
        """Whether what a frame says does not depend on when the nodes were asked."""
        return frame.arbitration_id >= 0x500

    assert run(disturbed=True) == run(disturbed=False)
