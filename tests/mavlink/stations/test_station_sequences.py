"""What QGroundControl, Mission Planner and mavros send, in their order, and what they wait for.

Each sequence names the files of the station's source that it follows.
"""

import math
import struct

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.messages.control import SafetyState
from robotctl.safety.state_machine import POWERED
from tests.mavlink.stations.station import ROBOT, START, Station, on_globe

MISSION, FENCE, RALLY = 0, 1, 2
GLOBAL, RELATIVE, RELATIVE_INT = 0, 3, 6
WAYPOINT = m.MAV_CMD_NAV_WAYPOINT
CUSTOM = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
PLACES = (6.8, 5.0), (6.8, 5.6)
GOAL = 6.2, 5.6
CORNERS = (4.0, 3.0), (9.0, 3.0), (9.0, 8.0), (4.0, 8.0)
PX4 = {"HOLD": (4, 3), "AUTO": (4, 4), "RTL": (4, 5)}
ARDUPILOT = {"HOLD": 4, "AUTO": 10, "RTL": 11, "GUIDED": 15}


def way_points(first, frame=RELATIVE_INT):
    """Return items to the places, with home in front if `first`; after the sequence number."""
    places = [START[:2]] * first + list(PLACES)
    return [
        (frame, WAYPOINT, int(not k), 1, 0.0, 0.0, 0.0, math.nan, *on_globe(*place), 0.0)
        for k, place in enumerate(places)
    ]


def fence():
    corner = m.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    return [
        (GLOBAL, corner, 0, 1, float(len(CORNERS)), 0.0, 0.0, 0.0, *on_globe(*place), 0.0)
        for place in CORNERS
    ]


def rally():
    place = on_globe(*START[:2])
    return [(RELATIVE, m.MAV_CMD_NAV_RALLY_POINT, 0, 1, 0.0, 0.0, 0.0, 0.0, *place, 0.0)]


def places_of(items):
    return [(each.x, each.y) for each in items]


def is_at_rest(station):
    return abs(station.robot.tick().v_m_s) < 0.01


def drive_all(station, start, goto, become):
    """Drive the mission, go somewhere, return, and disarm, by the words of a station."""
    robot = station.robot
    start()
    station.until(lambda: robot.state.mission_completed, 30.0)
    assert station.is_near(*PLACES[-1])
    goto()
    station.until(lambda: station.is_near(*GOAL) and robot.state.goal_reached, 15.0)
    become("RTL")
    station.until(lambda: station.is_near(*START[:2]) and is_at_rest(station), 30.0)
    station.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    assert robot.tick().state is SafetyState.STANDBY


def connect_qgroundcontrol(station, *, is_ardupilot):
    """Ask for what it needs to know of a robot that it has not seen before."""
    for number, kind in ((148, "AUTOPILOT_VERSION"), (435, "AVAILABLE_MODES")):
        station.command(m.MAV_CMD_REQUEST_MESSAGE, number)
        station.expect(kind)
    station.command(m.MAV_CMD_REQUEST_MESSAGE, 397)
    for number in (m.MAVLINK_MSG_ID_HOME_POSITION, m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE):
        station.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1_000_000)
    if is_ardupilot:
        for stream, rate_hz in ((1, 2), (2, 2), (3, 2), (6, 3), (10, 10), (11, 10), (12, 3)):
            station.send(m.MAVLink_request_data_stream_message(*ROBOT, stream, rate_hz, 1))
    assert len(station.parameters()) > 50
    for kind in (MISSION, FENCE, RALLY):
        assert len(station.download(kind)) == 0
    kinds = {each.get_type() for each in station.listen(2.0)}
    assert {"GLOBAL_POSITION_INT", "HOME_POSITION", "EXTENDED_SYS_STATE"} <= kinds
    assert not is_ardupilot or {"ATTITUDE", "SYS_STATUS"} <= kinds


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_what_qgroundcontrol_sends_is_answered_and_driven(personality):
    """By src/Vehicle/InitialConnectStateMachine.cc, src/FirmwarePlugin/APM/APMFirmwarePlugin.cc and
    PX4/PX4FirmwarePlugin.cc, src/MissionManager/PlanManager.cc, src/Vehicle/Vehicle.cc."""
    station = Station(personality=personality)
    is_ardupilot = personality == "ardupilot"
    station.listen(2.0)
    connect_qgroundcontrol(station, is_ardupilot=is_ardupilot)
    plan = way_points(is_ardupilot)
    station.upload(MISSION, plan)
    assert places_of(station.download(MISSION))[-2:] == [on_globe(*each) for each in PLACES]
    station.upload(FENCE, fence())
    station.upload(RALLY, rally())
    assert places_of(station.download(RALLY)) == [on_globe(*START[:2])]

    def become(mode):
        if is_ardupilot:  # setFlightMode sends the message, and asks again where it is not so
            station.send(m.MAVLink_set_mode_message(1, CUSTOM, ARDUPILOT[mode]))
            return
        station.command(m.MAV_CMD_DO_SET_MODE, CUSTOM, *PX4[mode])

    def start():
        if is_ardupilot:
            become("AUTO")
        station.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if not is_ardupilot:
            become("AUTO")
        station.command(m.MAV_CMD_MISSION_START)

    def goto():
        if is_ardupilot:
            become("GUIDED")
            station.listen(0.5)
        change_mode, any_radius = 1, 0.0
        station.command_int(
            m.MAV_CMD_DO_REPOSITION, -1.0, change_mode, any_radius, math.nan,
            place=on_globe(*GOAL), frame=GLOBAL,
        )  # fmt: skip

    drive_all(station, start, goto, become)


def test_what_mission_planner_sends_is_answered_and_driven():
    """By ExtLibs/ArduPilot/Mavlink/MAVLinkInterface.cs and MAVFtp.cs, ExtLibs/ArduPilot/
    mav_mission.cs, ExtLibs/ArduPilot/CurrentState.cs (which streams it asks for)."""
    station = Station(settings=("imu.enabled=true",))
    station.listen(2.0)
    station.command(m.MAV_CMD_REQUEST_MESSAGE, 148)
    station.expect("AUTOPILOT_VERSION")
    station.command(42_428)  # DO_SEND_BANNER, of the ardupilotmega dialect
    station.expect("STATUSTEXT")
    packed = read_file(station, b"@PARAM/param.pck")
    assert struct.unpack_from("<H", packed)[0] == 0x671B
    for stream, rate_hz in ((2, 2), (6, 2), (10, 4), (11, 4), (12, 2), (1, 2), (3, 2)):
        station.send(*[m.MAVLink_request_data_stream_message(*ROBOT, stream, rate_hz, 1)] * 2)
    kinds = {each.get_type() for each in station.listen(2.0)}
    assert {"ATTITUDE", "VFR_HUD", "GPS_RAW_INT", "SYS_STATUS"} <= kinds
    assert {"EKF_STATUS_REPORT", "VIBRATION", "SERVO_OUTPUT_RAW", "RC_CHANNELS"} <= kinds

    station.upload(MISSION, way_points(first=1, frame=RELATIVE))
    station.send(m.MAVLink_mission_ack_message(*ROBOT, 0, MISSION))  # setWPACK, after an upload too
    assert places_of(station.download(MISSION))[1:] == [on_globe(*each) for each in PLACES]
    station.upload(FENCE, fence())
    assert len(station.download(FENCE)) == len(CORNERS)

    def become(mode):
        for _ in range(2):  # setMode
            station.send(m.MAVLink_set_mode_message(1, CUSTOM, ARDUPILOT[mode]))
            station.listen(0.01)
        station.until(lambda: station.robot.state.mode == ARDUPILOT[mode], 1.0)

    def start():
        become("AUTO")
        station.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        assert station.robot.tick().state in POWERED

    def goto():
        become("GUIDED")  # setGuidedModeWP: an item that is current 2
        item = (RELATIVE_INT, WAYPOINT, 2, 1, 0.0, 0.0, 0.0, 0.0, *on_globe(*GOAL), 5.0)
        station.send(m.MAVLink_mission_item_int_message(*ROBOT, 0, *item, MISSION))
        station.expect("MISSION_ACK", type=0)

    drive_all(station, start, goto, become)


def test_what_mavros_sends_is_answered_and_driven():
    """By mavros/src/plugins: sys_status.cpp, sys_time.cpp, command.cpp, home_position.cpp,
    param.cpp, waypoint.cpp, mission_protocol_base.cpp and setpoint_velocity.cpp.

    It is a component of the robot's own system.
    """
    station = Station(1, 191, m.MAV_TYPE_ONBOARD_CONTROLLER)
    robot = station.robot
    station.send(m.MAVLink_timesync_message(0, 1_000_000))
    assert station.expect("TIMESYNC", ts1=1_000_000).tc1 > 0
    station.send(m.MAVLink_system_time_message(1_700_000_000_000_000, 0))
    station.command(520, 1, to=(0, 0))
    station.expect("AUTOPILOT_VERSION")
    station.send(m.MAVLink_request_data_stream_message(*ROBOT, 0, 10, 1))
    station.command(m.MAV_CMD_GET_HOME_POSITION)
    station.expect("HOME_POSITION")
    assert len(station.parameters()) > 50
    station.send(m.MAVLink_param_set_message(*ROBOT, b"CRUISE_SPEED", 0.35, 9))
    assert station.expect("PARAM_VALUE", param_id="CRUISE_SPEED").param_value == pytest.approx(0.35)
    assert len(station.download(MISSION)) == 0
    station.upload(MISSION, way_points(first=1))
    assert places_of(station.download(MISSION))[1:] == [on_globe(*each) for each in PLACES]

    def become(mode):
        station.send(m.MAVLink_set_mode_message(1, CUSTOM, ARDUPILOT[mode]))
        station.until(lambda: robot.state.mode == ARDUPILOT[mode], 1.0)

    def start():
        become("AUTO")
        station.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1, confirmation=1)

    def goto():
        """Steer by velocities with a yaw rate at 20 Hz, as a ROS program does; then a position."""
        become("GUIDED")
        _, y_m, _ = robot.pose()
        for _ in range(40):
            station.send(set_point(robot, 0x5C7, v=(-0.2, 0.0, 0.0)))  # south, where its back is
            station.listen(0.05)
        assert robot.pose()[1] < y_m - 0.1
        station.send(set_point(robot, 0xDF8, at=(GOAL[1], GOAL[0], 0.0)))

    drive_all(station, start, goto, become)


def set_point(robot, mask, at=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0)):
    rest = 0.0, 0.0, 0.0, 0.0, 0.0
    return m.MAVLink_set_position_target_local_ned_message(
        robot.now_ns // 1_000_000, *ROBOT, m.MAV_FRAME_LOCAL_NED, mask, *at, *v, *rest
    )


def read_file(station, name):
    """Read a file by MAVLink FTP: open it, read it in bursts, end the session."""
    open_file, burst, end = 4, 15, 1
    session, size, content, number = 0, 80, b"", 0

    def ask(code, offset=0, data=b""):
        nonlocal number
        number += 1
        head = struct.pack("<HBBBBBxI", number, session, code, len(data) or size, 0, 0, offset)
        payload = list((head + data).ljust(251, b"\0"))
        station.send(m.MAVLink_file_transfer_protocol_message(0, *ROBOT, payload))

    def told(heard):
        for message in heard:
            if message.get_type() == "FILE_TRANSFER_PROTOCOL":
                payload = bytes(message.payload)
                yield payload[3], payload[2], payload[12 : 12 + payload[4]]

    ask(open_file, data=name)
    ((code, session, data),) = told(station.listen(0.5))
    assert code == 128, "it opens"
    (length,) = struct.unpack("<I", data)
    while len(content) < length:
        ask(burst, len(content))
        parts = list(told(station.listen(1.0)))
        assert parts, "something comes"
        content += b"".join(data for code, _, data in parts if code == 128)
    ask(end)
    return content
