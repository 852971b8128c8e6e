"""Bring-up, seventh step: a ground station watches and drives, through an independent peer."""

from __future__ import annotations

import pytest

from hil_tests.ground_station import GroundStation, mavlink
from hil_tests.rig import PATIENT_S
from robotctl.messages.control import SafetyState

GUIDED = 15


@pytest.fixture
def station(lasting_station: GroundStation) -> GroundStation:
    """The ground station that all these tests share."""
    return lasting_station


def test_it_sees_a_rover_and_all_its_telemetry(station: GroundStation) -> None:
    beat = station.wait("HEARTBEAT")
    assert beat.type == mavlink.MAV_TYPE_GROUND_ROVER
    assert beat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    for kind in (
        "SYS_STATUS",
        "BATTERY_STATUS",
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "ODOMETRY",
        "WHEEL_DISTANCE",
        "DISTANCE_SENSOR",
    ):
        station.wait(kind)


def test_the_robots_side_says_who_came(station: GroundStation) -> None:
    station.wait("SYS_STATUS")
    # The first station may be greeted before the bench has subscribed to notices; not the next.
    own, station.link.mav.srcSystem = station.link.mav.srcSystem, 254
    station.wait("HEARTBEAT")
    wanted = "Ground station 254 connected"
    station.rig.wait(
        lambda: wanted in station.rig.notices, PATIENT_S, "the robot's side says so too"
    )
    assert station.rig.notices.count(wanted) == 1
    station.link.mav.srcSystem = own


def test_it_arms_drives_to_the_right_and_stops_when_it_falls_silent(
    station: GroundStation,
) -> None:
    rig = station.rig
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    mode = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, *mode) == mavlink.MAV_RESULT_ACCEPTED
    before = rig.fresh_truth()
    station.velocity(0.2, 0.5, 1.5)
    after = rig.fresh_truth()
    assert after.distance_m - before.distance_m > 0.15
    assert after.theta_rad < before.theta_rad - 0.3, "positive FRD yaw rate turns right"
    rig.wait_for_state(SafetyState.ARMED, 3.0)
    stopped = rig.fresh_truth()
    assert stopped.distance_m - after.distance_m < 0.4


def test_it_sees_the_can_bus_and_reads_an_object_of_a_node(station: GroundStation) -> None:
    node, identity = 1, (0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0)  # upload 0x1018, 1: the vendor
    assert station.command(mavlink.MAV_CMD_CAN_FORWARD, 1) == mavlink.MAV_RESULT_ACCEPTED
    heartbeat = station.wait("CAN_FRAME", lambda frame: frame.id == 0x700 + node)
    assert heartbeat.len == 1
    station.link.mav.can_frame_send(1, 1, 0, 8, 0x600 + node, identity)
    answer = station.wait(  # control reads objects of the node, too
        "CAN_FRAME",
        lambda frame: frame.id == 0x580 + node and bytes(frame.data[:4]) == b"\x43\x18\x10\x01",
    )
    (vendor,) = station.rig.read_objects(node, [(0x1018, 1)])
    assert int.from_bytes(bytes(answer.data[4:]), "little") == vendor
    station.link.mav.can_frame_send(1, 1, 0, 2, 0x000, (2, 1, 0, 0, 0, 0, 0, 0))  # NMT: stop it
    refusal = station.wait("STATUSTEXT", lambda text: text.text.startswith("CAN: 0x0 found"))
    assert "SDO" in refusal.text
    station.rig.wait_for_state(SafetyState.STANDBY)
