"""Bring-up, seventh step: a ground station watches and drives, through an independent peer."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator

import pytest

from hil_tests.rig import Rig
from robotctl.app.stack import NAVIGATION, TELEMETRY
from robotctl.runtime.messages import SafetyState

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

mavlink = mavutil.mavlink
GUIDED = 15
BODY_VELOCITY = 0b0000_0111_1100_0111
"""Of SET_POSITION_TARGET_LOCAL_NED only velocity, and yaw rate, are used."""


class GroundStation:
    """A `mavutil` connection that keeps its heartbeat up while it waits."""

    def __init__(self, rig: Rig, port: int) -> None:
        self.rig = rig
        self.link = mavutil.mavlink_connection(
            f"tcp:127.0.0.1:{port}", source_system=255, source_component=190, retries=20
        )

    def wait(self, kind: str, accept: Callable[[object], bool] = lambda _: True, seconds=5.0):
        deadline_s = time.monotonic() + seconds
        beat_s = 0.0
        while time.monotonic() < deadline_s:
            if time.monotonic() - beat_s > 0.5:
                beat_s = time.monotonic()
                self.link.mav.heartbeat_send(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
                )
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.1)
            if message is not None and accept(message):
                return message
        raise AssertionError(f"no such {kind} within {seconds} s")

    def command(self, number: int, *params: float) -> int:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.link.mav.command_long_send(1, 1, number, 0, *padded)
        return self.wait("COMMAND_ACK", lambda ack: ack.command == number).result

    def velocity(self, forward_m_s: float, yaw_rate_rad_s: float, seconds: float) -> None:
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            self.link.mav.set_position_target_local_ned_send(
                0,
                1,
                1,
                mavlink.MAV_FRAME_BODY_NED,
                BODY_VELOCITY,
                0,
                0,
                0,
                forward_m_s,
                0,
                0,
                0,
                0,
                0,
                0,
                yaw_rate_rad_s,
            )
            time.sleep(0.1)
            self.rig.listen()


@pytest.fixture
def station(make_rig: Callable[..., Rig]) -> Iterator[GroundStation]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    rig = make_rig(mavlink_url=f"tcpin:127.0.0.1:{port}")
    rig.start_firmware()
    for module in (None, NAVIGATION, TELEMETRY):
        rig.start(module) if module else rig.start()
    rig.wait_for_state(SafetyState.STANDBY)
    station = GroundStation(rig, port)
    station.wait("HEARTBEAT", seconds=10)
    yield station
    station.link.close()


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
    wanted = "Ground station 255 is here"
    station.rig.wait(lambda: wanted in station.rig.notices, 5.0, "the robot's side says so too")


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


def test_its_emergency_stop_latches(station: GroundStation) -> None:
    rig = station.rig
    station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    rig.wait_for_state(SafetyState.ARMED)
    station.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    beat = station.wait("HEARTBEAT", lambda b: b.system_status == mavlink.MAV_STATE_EMERGENCY)
    assert not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
