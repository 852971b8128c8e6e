"""What a node was told is read back for as long as it is in service; NMT of strangers is heard."""

import struct

import pytest

from robotctl.drivers.can.nodes.read_back import UNREAD_MAX
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.faults import FaultCode
from tests.drivers.can.nodes.fake_nodes import OPERATIONAL, FakeBus

MS = 1_000_000
ROUND_MS = 800
"""All seven settings of the drive, one each 100 ms, and one of them twice."""
DEVICE_STATE = 0x08000022
SETTINGS = [
    ("drive", 0x2000, 0, 2000, "command time-out reads back 2000 ms, wanted 100 ms"),
    ("drive", 0x1801, 2, 240, "period of MotorStatus reads back 240 SYNC, wanted 4 SYNC"),
    ("drive", 0x1802, 2, 1, "period of DriveStatus reads back 1 SYNC, wanted 4 SYNC"),
    ("drive", 0x1017, 0, 340, "heartbeat period reads back 340 ms, wanted 100 ms"),
    ("drive", 0x2003, 0, 200000, "current limit reads back 200000 mA, wanted 5000 mA"),
    ("drive", 0x2004, 0, 200, "over-temperature limit reads back 200 degC, wanted 120 degC"),
    ("drive", 0x2005, 0, 0, "under-voltage limit reads back 0 mV, wanted 9000 mV"),
    ("sonar", 0x2201, 0, 240, "ring period reads back 240 ms, wanted 50 ms"),
    ("sonar", 0x1017, 0, 0, "heartbeat period reads back 0 ms, wanted 100 ms"),
    ("power", 0x2300, 0, 0, "low limit reads back 0 mV, wanted 10500 mV"),
    ("power", 0x2301, 0, 0, "critical limit reads back 0 mV, wanted 9600 mV"),
    ("power", 0x1017, 0, 1, "heartbeat period reads back 1 ms, wanted 100 ms"),
]
OWN_LIMITS = {0x1017, 0x2003, 0x2004, 0x2005, 0x2300, 0x2301}


@pytest.fixture
def bus(codec, parameters, clock):
    bus = FakeBus(codec, parameters, clock)
    bus.run(500)
    assert bus.problems() == ["", "", ""]
    return bus


@pytest.mark.parametrize(("name", "index", "sub", "value", "words"), SETTINGS)
def test_what_is_changed_in_service_takes_the_node_out_of_it_and_is_named(
    bus, name, index, sub, value, words
):
    node = getattr(bus, name)
    before = node.objects[index, sub]
    node.objects[index, sub] = value
    bus.run(ROUND_MS)
    problem = f"{name} (node {node.node_id}): {words}: it was changed"
    assert bus.status(node.node_id).problem == problem
    assert sum(map(bool, bus.problems())) == 1
    bus.run(1500)
    assert bus.problems() == ["", "", ""]
    assert node.objects[index, sub] == (value if index in OWN_LIMITS else before)


def test_readings_never_end_and_take_little_of_the_bus(bus):
    first = len(bus.sent)
    bus.run(10_000)
    requests = [data for _, can_id, data in bus.sent[first:] if can_id in (0x601, 0x602, 0x603)]
    assert {data[0] for data in requests} == {0x40}, "nothing is written"
    assert 290 <= len(requests) <= 303
    assert bus.problems() == ["", "", ""]


def test_one_damaged_answer_stops_nobody_but_two_do(bus):
    asked = bus.drive.on_request
    lies = 0

    def on_request(data):
        nonlocal lies
        if lies and data[1:4] == b"\x00\x20\x00":
            lies -= 1
            bus.deliver(0x581, struct.pack("<BHBI", 0x43, 0x2000, 0, 101))
        else:
            asked(data)

    bus.drive.on_request = on_request
    lies = 1
    bus.run(3 * ROUND_MS)
    assert lies == 0
    assert bus.problems() == ["", "", ""]
    lies = 2
    bus.run(ROUND_MS)
    assert bus.status(1).problem == (
        "drive (node 1): command time-out reads back 101 ms, wanted 100 ms: it was changed"
    )


def test_a_node_that_is_asked_by_others_too_is_not_blamed_for_a_few_lost_answers(bus):
    bus.drive.deaf = 4 * UNREAD_MAX  # each reading is tried four times
    bus.run(UNREAD_MAX * 350)
    assert bus.drive.deaf == 0
    bus.run(500)
    assert bus.problems() == ["", "", ""]


def test_a_node_that_answers_no_reading_at_all_is_named(bus):
    bus.drive.deaf = 10_000
    bus.run((UNREAD_MAX + 1) * 350)
    assert bus.status(1).fault == FaultCode.NODE_NO_ANSWER, bus.status(1).problem


def test_an_answer_to_a_strangers_write_is_not_taken_for_a_value(bus):
    for _ in range(100):
        bus.deliver(0x581, struct.pack("<BHBI", 0x60, 0x2000, 0, 0))
        bus.deliver(0x581, struct.pack("<BHBI", 0x80, 0x2000, 0, DEVICE_STATE))
        bus.run(25)
    assert bus.problems() == ["", "", ""]


@pytest.mark.parametrize("ticks", range(25))
def test_clearing_faults_does_not_wait_for_a_reading(bus, ticks):
    bus.run(5 * ticks)
    bus.drive.objects[0x2010, 0] = 0
    bus.robot.clear_faults()
    bus.run(15)
    assert bus.drive.objects[0x2010, 0] == 1
    bus.run(2 * ROUND_MS)
    assert bus.problems() == ["", "", ""]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (2, "was stopped"),
        (128, "was put into pre-operational"),
        (129, "was reset"),
        (130, "was reset"),
    ],
)
@pytest.mark.parametrize("addressed", [0, 1])
def test_nmt_of_somebody_else_takes_the_node_out_of_service_at_once(bus, command, words, addressed):
    bus.deliver(0x000, bytes((command, addressed)))
    feedback = bus.robot.receive(bus.clock.now_ns())
    problems = [node.problem for node in feedback.nodes]
    assert problems[0] == f"drive (node 1): {words} by another device on the bus (NMT)"
    assert [bool(problem) for problem in problems] == [True, addressed == 0, addressed == 0]
    bus.robot.send(ActuatorCommand(), bus.clock.now_ns())
    for node in bus.nodes:
        if addressed in (0, node.node_id):
            node.state = {2: 4}.get(command, 127)
    bus.run(1500)
    assert bus.problems() == ["", "", ""]
    assert [node.state for node in bus.nodes] == [OPERATIONAL] * 3


@pytest.mark.parametrize(
    "data", [b"\x01\x00", b"\x01\x01", b"\x02\x05", b"\x07\x01", b"\x02", b"", b"\x02\x01\x00"]
)
def test_nmt_that_takes_no_node_out_of_service_changes_nothing(bus, data):
    bus.deliver(0x000, data)
    bus.run(500)
    assert bus.problems() == ["", "", ""]


READ_1018 = bytes.fromhex("4018100100000000")


def requests_to(bus, node_id, first):
    return [data for _, can_id, data in bus.sent[first:] if can_id == 0x600 + node_id]


def test_a_node_that_somebody_else_asks_is_left_to_him_for_half_a_second(bus):
    bus.run(300)
    bus.deliver(0x601, READ_1018)
    bus.run(5)
    first = len(bus.sent)
    bus.run(480)
    assert not requests_to(bus, 1, first)
    assert len(requests_to(bus, 2, first)) >= 4
    bus.run(120)
    assert requests_to(bus, 1, first)


def test_who_asks_without_an_end_hides_no_change(bus):
    bus.drive.objects[0x2000, 0] = 2000
    for _ in range(8_500 // 100):
        bus.deliver(0x601, READ_1018)
        bus.run(100)
        if bus.status(1).problem:
            break
    assert bus.status(1).fault == FaultCode.NODE_CHANGED, bus.status(1).problem
