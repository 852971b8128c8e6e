"""The CAN bus over MAVLink: out to who asks, in only what cannot move the robot."""

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import SafetyState
from robotctl.messages.mavlink_port import Peer
from robotctl.safety.state_machine import ENABLED
from tests.mavlink.conftest import Bench

FIRST, SECOND = Peer(0, 0), Peer(1, 0)
HEARTBEAT, STATUS = (0x701, b"\x05"), (0x181, bytes(range(8)))


class Bus:
    """A bus that a test fills."""

    works, is_open = True, False

    def __init__(self):
        self.coming, self.sent = [], []

    def open(self):
        self.is_open = self.works
        return self.works

    def receive(self):
        coming, self.coming = self.coming, []
        return coming

    def send(self, number, data):
        self.sent.append((number, data))

    def close(self):
        self.is_open = False


@pytest.fixture
def bench():
    bench = Bench(2)
    bench.can = Bus()
    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, can=bench.can)
    bench.step(bench.control())
    bench.take()
    return bench


def forward(bench, bus=1, peer=FIRST):
    bench.command(m.MAV_CMD_CAN_FORWARD, bus, peer=peer)
    bench.step(bench.control())
    (ack,) = bench.messages("COMMAND_ACK")
    return ack.result


def frames(bench, *coming):
    bench.can.coming = list(coming)
    bench.step(bench.control())
    return [(x.id, bytes(x.data[: x.len]), peer) for x, peer in bench.take("CAN_FRAME")]


def test_frames_go_to_who_asks_for_five_seconds_and_the_bus_is_closed_then(bench):
    assert frames(bench, HEARTBEAT) == []
    assert not bench.can.is_open
    assert forward(bench) == m.MAV_RESULT_ACCEPTED
    assert frames(bench, HEARTBEAT, STATUS) == [(*HEARTBEAT, FIRST), (*STATUS, FIRST)]
    bench.run(4.0)
    forward(bench)
    bench.run(4.0)
    assert frames(bench, STATUS) == [(*STATUS, FIRST)]
    bench.run(2.0)
    assert frames(bench, STATUS) == []
    assert not bench.can.is_open


def test_it_ends_when_asked_and_what_cannot_be_had_is_refused(bench):
    forward(bench)
    assert forward(bench, 0) == m.MAV_RESULT_ACCEPTED
    assert frames(bench, STATUS) == []
    assert forward(bench, 2) == m.MAV_RESULT_DENIED
    bench.can.works = False
    assert forward(bench) == m.MAV_RESULT_FAILED


def test_each_chooses_its_identifiers(bench):
    forward(bench)
    forward(bench, peer=SECOND)
    ids = [0x701, *[0] * 15]
    bench.receive(m.MAVLink_can_filter_modify_message(1, 1, 0, m.CAN_FILTER_REPLACE, 1, ids))
    bench.step()
    assert frames(bench, HEARTBEAT, STATUS) == [
        (*HEARTBEAT, FIRST), (*HEARTBEAT, SECOND), (*STATUS, SECOND),
    ]  # fmt: skip
    bench.receive(m.MAVLink_can_filter_modify_message(1, 1, 0, m.CAN_FILTER_REMOVE, 1, ids))
    bench.step()
    assert len(frames(bench, HEARTBEAT, STATUS)) == 4


@pytest.mark.parametrize("state", SafetyState)
@pytest.mark.parametrize("number", [0x000, 0x001, 0x080, 0x201, 0x581, 0x600, 0x601, 0x67F, 0x680])
def test_only_sdo_requests_come_in_and_only_to_a_robot_without_power(bench, state, number):
    """CiA 301, predefined connection set: 0x600 and the node's number, 1 to 127."""
    request = m.MAVLink_can_frame_message(1, 1, 0, 8, number, [0x40, 8, 16, 0, 0, 0, 0, 0])
    bench.receive(request)  # nobody listens yet
    bench.step(bench.control(state=state))
    assert bench.can.sent == []
    forward(bench)
    bench.step(bench.control(state=state))
    bench.receive(request)
    bench.step(bench.control(state=state))
    powered = state in ENABLED
    allowed = 0x601 <= number <= 0x67F and not powered
    assert bench.can.sent == ([(number, bytes([0x40, 8, 16, 0, 0, 0, 0, 0]))] if allowed else [])


def test_extended_identifiers_and_long_frames_stay_out(bench):
    forward(bench)
    for number, length in ((0x8000_0601, 8), (0x1_0601, 8), (0x601, 9)):
        bench.receive(m.MAVLink_can_frame_message(1, 1, 0, length, number, [0] * 8))
        bench.step(bench.control())
    assert bench.can.sent == []


def test_a_flood_is_cut(bench):
    forward(bench)
    assert len(frames(bench, *[STATUS] * 1000)) == 32
