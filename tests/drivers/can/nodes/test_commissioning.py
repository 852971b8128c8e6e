"""Commissioning against nodes that lie, keep silent, forget and restart."""

import dataclasses

import pytest

from robotctl.messages.faults import FaultCode
from tests.drivers.can.nodes.fake_nodes import (
    NO_OBJECT,
    OPERATIONAL,
    PRE_OPERATIONAL,
    STOPPED,
    FakeBus,
)
from tests.native_frames import TRICYCLE

MS = 1_000_000


@pytest.fixture
def bus(codec, parameters, clock):
    return FakeBus(codec, parameters, clock)


def test_before_a_node_is_heard_the_robot_says_so(bus):
    bus.drive.alive = False
    bus.run(50)
    assert bus.status(1).problem == "drive (node 1): not heard on the bus"
    assert bus.status(1).boots == 0


def test_all_nodes_are_identified_configured_and_started(bus):
    bus.run(400)
    assert bus.problems() == ["", "", ""]
    assert [node.nmt_state for node in bus.feedback.nodes] == [OPERATIONAL] * 3
    assert [node.state for node in bus.nodes] == [OPERATIONAL] * 3
    assert bus.drive.objects[0x2000, 0] == 100
    assert bus.drive.objects[0x1801, 2] == 4
    assert bus.drive.objects[0x1802, 2] == 4
    assert bus.sonar.objects[0x2201, 0] == 50


def test_a_node_is_started_only_after_it_was_identified_and_configured(bus):
    bus.run(400)
    frames = [
        (can_id, data)
        for _, can_id, data in bus.sent
        if can_id == 0x601 or (can_id == 0x000 and data[1] == 1)
    ]
    started = frames.index((0x000, b"\x01\x01"))
    read_back = [
        *(b"\x40\x00\x20\x00", b"\x40\x01\x18\x02", b"\x40\x02\x18\x02", b"\x40\x17\x10\x00"),
        *(b"\x40\x03\x20\x00", b"\x40\x04\x20\x00", b"\x40\x05\x20\x00"),
    ]
    after = [data[:4] for _, data in frames[started + 1 :]]
    assert after[:7] == read_back
    assert after[7:] == read_back[: len(after) - 7], "and from then on in turn"
    assert frames[0] == (0x601, bytes.fromhex("4018100100000000"))
    assert [can_id for can_id, _ in frames].count(0x000) == 1


def test_no_tick_carries_more_than_one_frame_of_node_services(bus):
    bus.run(600)
    ticks = [tick for tick, can_id, _ in bus.sent if can_id not in (0x201, 0x080)]
    assert len(ticks) > 20
    assert len(ticks) == len(set(ticks))


def test_command_and_sync_go_out_on_every_tick_in_this_order(bus):
    bus.run(200)
    for tick in range(1, bus.ticks + 1):
        ids = [can_id for sent, can_id, _ in bus.sent if sent == tick]
        assert ids[:2] == [0x201, 0x080]


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        (
            (0x1018, 1),
            0x123,
            "drive (node 1): vendor 0x00000123 is not ours 0x00526F62",
        ),
        (
            (0x1018, 2),
            2,
            "drive (node 1): is another device: product code 2 instead of 1",
        ),
        ((0x1018, 3), 0x20000, "drive (node 1): revision 0x00020000 is not 0x0001xxxx"),
        (
            (0x2001, 0),
            0xDEADBEEF,
            "drive (node 1): wire version 0xDEADBEEF is not ours 0x1C76FE73",
        ),
        (
            (0x2002, 0),
            4096,
            "drive (node 1): has 4096 counts per revolution, the configuration says 2400",
        ),
    ],
)
def test_a_drive_that_is_not_ours_is_not_started(bus, key, value, problem):
    bus.drive.objects[key] = value
    bus.run(700)
    assert bus.status(1).problem == problem.replace(
        "0x1C76FE73", f"0x{bus.codec.dbc.wire_version:08X}"
    )
    assert bus.drive.state == PRE_OPERATIONAL
    assert (0x000, b"\x01\x01") not in [frame[1:] for frame in bus.sent]


def test_a_ring_with_another_number_of_sonars_is_not_started(bus):
    bus.sonar.objects[0x2200, 0] = 12
    bus.run(700)
    assert bus.status(2).problem == ("sonar (node 2): has 12 sonars, the configuration says 8")
    assert bus.sonar.state == PRE_OPERATIONAL
    assert bus.problems()[0] == ""


def test_a_sonar_ring_of_another_wire_version_is_not_started(bus):
    bus.sonar.objects[0x2001, 0] = 1
    bus.run(700)
    assert bus.status(2).fault == FaultCode.NODE_OTHER_FIRMWARE, bus.status(2).problem


def test_a_time_out_that_reads_back_wrong_keeps_the_drive_out_of_service(bus):
    bus.drive.forgetful.add((0x2000, 0))
    bus.drive.objects[0x2000, 0] = 0
    bus.run(700)
    assert bus.status(1).problem == (
        "drive (node 1): command time-out reads back 0 ms, wanted 100 ms"
    )
    assert bus.drive.state == PRE_OPERATIONAL


@pytest.mark.parametrize(
    ("abort", "words"),
    [(0x06090030, "SDO abort 0x06090030"), (NO_OBJECT, "it has no such object")],
)
def test_a_refused_write_is_named(bus, abort, words):
    bus.drive.refusals[0x2000, 0] = abort
    bus.run(700)
    assert bus.status(1).problem == (
        f"drive (node 1): refused write of 0x2000:00 (command time-out): {words}"
    )


def test_a_drive_without_wire_version_is_refused_but_a_battery_monitor_is_not(bus):
    del bus.drive.objects[0x2001, 0]
    bus.run(700)
    assert bus.problems() == [
        "drive (node 1): refused read of 0x2001:00 (wire version): it has no such object",
        "",
        "",
    ]


def test_up_to_three_lost_answers_do_no_harm(bus):
    bus.drive.deaf = 3
    bus.run(700)
    assert bus.problems() == ["", "", ""]


def test_a_node_that_never_answers_is_named(bus):
    bus.drive.deaf = 10_000
    bus.run(700)
    assert bus.status(1).problem == ("drive (node 1): no answer to read of 0x1018:01 (vendor)")
    assert bus.problems()[1:] == ["", ""]


def test_a_refused_node_gets_another_chance_each_second(bus):
    bus.drive.objects[0x2002, 0] = 1
    bus.run(700)
    problem = bus.status(1).problem
    bus.drive.objects[0x2002, 0] = 2400
    bus.run(300)
    assert bus.status(1).problem == problem
    bus.run(1200)
    assert bus.problems() == ["", "", ""]


def test_a_node_that_does_not_obey_nmt_is_named_and_tried_again(bus):
    bus.drive.obeys_nmt = False
    bus.run(1200)
    assert bus.status(1).problem == "drive (node 1): does not become operational"
    assert [frame[1:] for frame in bus.sent].count((0x000, b"\x01\x01")) == 3
    bus.drive.obeys_nmt = True
    bus.run(1500)
    assert bus.problems() == ["", "", ""]


def test_a_node_in_nmt_stopped_answers_no_sdo_and_is_woken_first(bus):
    bus.power.state = STOPPED
    bus.run(600)
    assert bus.problems() == ["", "", ""]
    frames = [frame[1:] for frame in bus.sent]
    assert frames.index((0x000, b"\x80\x03")) < frames.index((0x000, b"\x01\x03"))


def test_a_node_that_reboots_is_commissioned_again_and_the_boot_is_counted(bus):
    bus.run(400)
    assert bus.status(1).boots == 1
    bus.drive.objects[0x2000, 0] = 250
    bus.drive.boot()
    bus.run(5)
    assert bus.status(1).problem == "drive (node 1): is being identified"
    assert bus.status(1).boots == 2
    bus.run(400)
    assert bus.problems() == ["", "", ""]
    assert bus.status(1).boots == 2
    assert bus.drive.objects[0x2000, 0] == 100


def test_a_boot_in_the_middle_of_commissioning_starts_it_over(bus):
    bus.run(100)
    bus.run(20)
    assert bus.status(1).problem
    before = len(bus.drive.requests)
    bus.drive.boot()
    bus.run(400)
    assert bus.problems() == ["", "", ""]
    assert bus.drive.requests[before:].count(((0x1018, 1), None)) >= 1
    assert bus.status(1).boots == 2


@pytest.mark.parametrize("after", range(1, 30))
def test_a_restart_that_nobody_heard_leaves_no_drive_in_service_with_other_settings(bus, after):
    asked, restarted = bus.drive.on_frame, []

    def on_frame(can_id, data):
        asked(can_id, data)
        if can_id == 0x601 or (can_id, data) == (0x000, b"\x01\x01"):
            restarted.append(None)
            if len(restarted) == after:  # its boot-up message is lost
                bus.drive.state = PRE_OPERATIONAL
                bus.drive.objects[0x2000, 0] = 250

    bus.drive.on_frame = on_frame
    in_service = 0
    for _ in range(600):
        bus.run(5)
        if bus.status(1).problem == "" and bus.drive.state == OPERATIONAL:
            in_service += 1
            assert bus.drive.objects[0x2000, 0] == 100
    assert in_service > 100
    assert bus.status(1).problem == ""


def test_a_time_out_that_is_not_there_any_more_once_the_drive_runs_is_named(bus):
    asked = bus.drive.on_frame

    def on_frame(can_id, data):
        asked(can_id, data)
        if (can_id, data) == (0x000, b"\x01\x01"):
            bus.drive.objects[0x2000, 0] = 250

    bus.drive.on_frame = on_frame
    bus.run(700)
    assert bus.status(1).problem == (
        "drive (node 1): command time-out reads back 250 ms, wanted 100 ms"
    )


def test_a_node_whose_heartbeat_stops_is_lost_after_its_time_and_not_before(bus):
    bus.run(500)
    bus.power.alive = False
    last_ns = bus.status(3).heartbeat_ns
    while bus.clock.now_ns() - last_ns < 345 * MS:
        bus.run(5)
        assert bus.status(3).problem == ""
    bus.run(10)
    assert bus.status(3).problem == "power (node 3): no heartbeat for 350 ms"


def test_a_lost_node_that_comes_back_without_a_word_counts_as_booted(bus):
    bus.run(500)
    bus.power.alive = False
    bus.run(500)
    bus.power.alive = True
    bus.run(500)
    assert bus.problems() == ["", "", ""]
    assert bus.status(3).boots == 2


def test_a_node_that_was_stopped_by_somebody_is_commissioned_again(bus):
    bus.run(500)
    bus.drive.state = PRE_OPERATIONAL
    bus.run(100)
    assert bus.status(1).problem != ""
    bus.run(400)
    assert bus.problems() == ["", "", ""]


def test_a_robot_without_sonars_does_not_ask_for_the_ring(codec, parameters, clock):
    bus = FakeBus(codec, dataclasses.replace(parameters, sonars=0), clock)
    bus.run(500)
    assert [node.node_id for node in bus.feedback.nodes] == [1, 3]
    assert bus.sonar.state == PRE_OPERATIONAL


def test_a_steered_robot_gets_its_drive_status_on_every_sync(codec, parameters, clock):
    bus = FakeBus(codec, dataclasses.replace(parameters, rate_hz=1000), clock, TRICYCLE)
    bus.run(500)
    assert bus.drive.objects[0x1801, 2] == 20
    assert bus.drive.objects[0x1802, 2] == 1


def test_clearing_faults_writes_the_drives_object_once(bus):
    bus.run(500)
    bus.robot.clear_faults()
    bus.run(50)
    writes = [request for request in bus.drive.requests if request[0] == (0x2010, 0)]
    assert writes == [((0x2010, 0), 1)]
    assert bus.problems() == ["", "", ""]


def test_a_refused_clearing_leaves_the_node_in_service(bus):
    bus.run(500)
    bus.drive.refusals[0x2010, 0] = 0x08000022
    bus.robot.clear_faults()
    bus.run(500)
    assert bus.problems() == ["", "", ""]
    bus.drive.refusals.clear()
    bus.robot.clear_faults()
    bus.run(50)
    assert bus.drive.objects[0x2010, 0] == 1


def test_clearing_does_not_wait_for_a_drive_that_is_not_in_service(bus):
    bus.run(5)
    bus.robot.clear_faults()
    bus.run(800)
    assert bus.problems() == ["", "", ""]
    assert bus.drive.objects[0x2010, 0] == 0


def test_an_unanswered_clearing_is_given_up(bus):
    bus.run(500)
    bus.drive.deaf = 4
    bus.robot.clear_faults()
    bus.run(500)
    bus.robot.clear_faults()
    bus.run(100)
    assert bus.drive.objects[0x2010, 0] == 1
    assert bus.problems() == ["", "", ""]
