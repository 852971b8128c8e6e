"""A ground station made of pymavlink's own connections talks to the robot over real sockets."""

import pytest
from pymavlink import mavutil

from robotctl.messages.control import EmergencyStop, ManualControl, SafetyState, VelocityTarget
from tests.mavlink.real_links import hear

mavlink = mavutil.mavlink


def test_a_ground_station_arms_changes_mode_drives_and_stops(pair, eventually):
    robot, gcs = pair
    beat = hear(eventually, robot, gcs, "HEARTBEAT")
    assert mavutil.mode_string_v10(beat) == "HOLD"
    assert gcs.mode_mapping()["GUIDED"] == 15
    assert not gcs.motors_armed()

    gcs.arducopter_arm()
    ack = hear(eventually, robot, gcs, "COMMAND_ACK")
    assert (ack.command, ack.result) == (400, mavlink.MAV_RESULT_ACCEPTED)
    hear(eventually, robot, gcs, "HEARTBEAT")
    assert gcs.motors_armed()

    gcs.set_mode("GUIDED")
    hear(eventually, robot, gcs, "HEARTBEAT", custom_mode=15)
    assert gcs.flightmode == "GUIDED"

    mask = 0x7FF & ~0x38  # velocity and yaw rate
    gcs.mav.set_position_target_local_ned_send(
        0, 1, 1, mavlink.MAV_FRAME_BODY_NED, mask, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, -0.25
    )
    gcs.mav.manual_control_send(1, 0, 0, 500, 0, 0)
    eventually(lambda: any(isinstance(r, ManualControl) for r in robot.requests), robot.step)
    target = next(r for r in robot.requests if isinstance(r, VelocityTarget))
    assert (target.v_m_s, target.omega_rad_s) == (0.5, 0.25)
    assert target.expires_ns - target.stamp_ns == 480_000_000

    gcs.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0, 1, 0, 0, 0, 0, 0, 0)
    assert hear(eventually, robot, gcs, "COMMAND_ACK", command=185).result == 0
    assert robot.state is SafetyState.EMERGENCY_STOP
    hear(eventually, robot, gcs, "HEARTBEAT", system_status=mavlink.MAV_STATE_EMERGENCY)


def test_a_ground_station_reads_pose_sonars_and_battery(pair, eventually):
    robot, gcs = pair
    assert hear(eventually, robot, gcs, "ATTITUDE").yaw == pytest.approx(0.0, abs=1e-6)
    position = hear(eventually, robot, gcs, "LOCAL_POSITION_NED")
    assert (position.x, position.y) == (2.0, 1.0)
    for name in ("ODOMETRY", "WHEEL_DISTANCE", "BATTERY_STATUS", "SYS_STATUS"):
        hear(eventually, robot, gcs, name)


def test_two_links_at_once_each_with_its_ground_station(start_robot, station, eventually):
    first = station("udpin:127.0.0.1:0")
    robot = start_robot(f"udpout:127.0.0.1:{first.port.getsockname()[1]}", "tcpin:127.0.0.1:0")
    second = station(f"tcp:127.0.0.1:{robot.port(1)}")
    for gcs in (first, second):
        hear(eventually, robot, gcs, "HEARTBEAT")
    first.mav.command_long_send(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
    assert hear(eventually, robot, first, "AUTOPILOT_VERSION").flight_sw_version >> 24 == 1
    second.mav.timesync_send(0, 77)
    assert hear(eventually, robot, second, "TIMESYNC").ts1 == 77
    assert first.recv_match(type="TIMESYNC", blocking=False) is None
    for gcs in (first, second):
        gcs.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4)
    eventually(lambda: [s.links for s in robot.telemetry.ground_stations] == [(0, 1)], robot.step)
    assert first.packet_loss() == second.packet_loss() == 0.0


def test_a_ground_station_that_speaks_mavlink_1_is_understood(start_robot, station, eventually):
    robot = start_robot("udpin:127.0.0.1:0")
    gcs = station(f"udpout:127.0.0.1:{robot.port()}")
    old = gcs.mav.command_long_encode(1, 1, 185, 0, 1, 0, 0, 0, 0, 0, 0)
    gcs.mav.send(old, force_mavlink1=True)
    eventually(lambda: robot.requests, robot.step)
    assert isinstance(robot.requests[0], EmergencyStop)
