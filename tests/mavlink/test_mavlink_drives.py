"""What a ground station sends, and where the simulated robot then truly drives."""

import itertools
import math

import pytest
from pymavlink.dialects.v20 import common

from tests.mavlink.conftest import FakeLinks
from tests.mavlink.driven_robot import ARM, DrivenRobot

MANUAL, HOLD, AUTO, GUIDED = 0, 4, 10, 15
VELOCITY, VELOCITY_AND_RATE, POSITION = 0xFC7, 0x7C7, 0xDF8
NORTH_EAST = math.pi / 4


def sticks(z=0, y=0, x=0, r=0):
    return common.MAVLink_manual_control_message(1, x, y, z, r, 0)


def setpoint(frame, mask, **fields):
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    values = [fields.get(name, 0.0) for name in names]
    return common.MAVLink_set_position_target_local_ned_message(0, 1, 0, frame, mask, *values)


def moved(robot, seconds, message):
    """Return how far the robot drives ahead and to the left [m], and turns to the left [rad]."""
    x, y, theta = robot.pose()
    robot.run(seconds, message)
    x2, y2, theta2 = robot.pose()
    dx, dy = x2 - x, y2 - y
    ahead = dx * math.cos(theta) + dy * math.sin(theta)
    left = -dx * math.sin(theta) + dy * math.cos(theta)
    return ahead, left, math.remainder(theta2 - theta, math.tau)


@pytest.mark.parametrize("name", ["diff_drive", "ackermann"])
def test_the_throttle_drives_and_the_stick_to_the_right_turns_right(name):
    robot = DrivenRobot(FakeLinks(), name, (6.0, 5.0, NORTH_EAST))
    robot.arm(MANUAL)
    ahead, left, turn = moved(robot, 1.5, sticks(z=400))
    assert ahead > 0.2
    assert abs(left) < 0.05
    assert abs(turn) < 0.05
    ahead, _, turn = moved(robot, 1.5, sticks(z=400, y=500))
    assert ahead > 0.1
    assert turn < -0.2
    robot.run(2.0)
    ahead, _, _ = moved(robot, 1.5, sticks(z=-400))
    assert ahead < -0.2
    robot.run(2.0)
    assert moved(robot, 1.0, sticks(x=1000, r=1000)) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_an_offset_is_driven_from_where_the_robot_stands():
    """It faces north-east: to its right is south-east."""
    robot = DrivenRobot(FakeLinks(), start=(6.0, 5.0, NORTH_EAST))
    robot.arm(GUIDED)
    robot.send(setpoint(common.MAV_FRAME_BODY_OFFSET_NED, POSITION, y=0.5))
    robot.run(5.0)
    assert robot.state.goal_reached
    side = 0.5 * math.sqrt(0.5)
    assert robot.pose()[:2] == pytest.approx((6.0 + side, 5.0 - side), abs=0.1)
    robot.send(setpoint(common.MAV_FRAME_BODY_NED, POSITION, x=0.5))
    robot.run(3.0)
    assert robot.pose()[:2] == pytest.approx((6.0 + 2 * side, 5.0 - 2 * side), abs=0.15)
    before = robot.pose()
    robot.send(setpoint(common.MAV_FRAME_LOCAL_OFFSET_NED, POSITION, x=0.5))
    robot.run(6.0)
    assert robot.pose()[:2] == pytest.approx((before[0], before[1] + 0.5), abs=0.1)


def test_a_velocity_north_leads_north_and_a_positive_yaw_rate_to_the_right():
    robot = DrivenRobot(FakeLinks(), start=(6.0, 5.0, NORTH_EAST))
    robot.arm(GUIDED)
    north = setpoint(common.MAV_FRAME_LOCAL_NED, VELOCITY, vx=0.3)
    robot.run(4.0, north)
    x, y, theta = robot.pose()
    assert theta == pytest.approx(math.pi / 2, abs=0.1)
    assert y - 5.0 > 0.3
    assert abs(x - 6.0) < 0.3
    body = setpoint(common.MAV_FRAME_BODY_NED, VELOCITY_AND_RATE, vx=0.2, yaw_rate=0.5)
    ahead, left, turn = moved(robot, 2.0, body)
    assert ahead > 0.2
    assert left < 0.0
    assert -1.2 < turn < -0.7


@pytest.mark.parametrize(
    ("mode", "message", "every_s", "most_s"),
    [
        (GUIDED, setpoint(common.MAV_FRAME_BODY_NED, VELOCITY, vx=0.3), 0.1, 0.3),
        (GUIDED, setpoint(common.MAV_FRAME_BODY_NED, VELOCITY, vx=0.3), 0.4, 0.5),
        (MANUAL, sticks(z=375), 0.1, 0.5),
    ],
)
def test_a_robot_that_is_told_nothing_more_brakes_in_time(mode, message, every_s, most_s):
    """Braking takes as long as the limits say, and no longer."""
    robot = DrivenRobot(FakeLinks())
    robot.arm(mode)
    robot.run(2.0, message, every_s)
    robot.send(message)
    silent_ns = robot.now_ns
    while robot.tick().v_ref_m_s >= 0.299:
        pass
    assert most_s - 0.05 < (robot.now_ns - silent_ns) / 1e9 <= most_s
    while robot.tick().v_ref_m_s > 0.0:
        pass
    limits = robot.config.limits
    ramp_s = 0.3 / limits.a_max_m_s2 + limits.a_max_m_s2 / limits.jerk_max_m_s3
    periods_ns = 2 * robot.stack.period_ns
    assert robot.now_ns - silent_ns <= (most_s + ramp_s) * 1e9 + periods_ns


def test_a_position_is_given_up_when_the_ground_station_is_lost():
    links = FakeLinks()
    robot = DrivenRobot(links)
    robot.arm(GUIDED)
    beat = common.MAVLink_heartbeat_message(common.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
    robot.send(setpoint(common.MAV_FRAME_BODY_NED, POSITION, x=3.9))
    robot.run(1.0, beat, every_s=1.0)
    silent_ns = robot.now_ns
    while robot.tick() and robot.state.mode == GUIDED:
        pass
    assert 4.0e9 <= robot.now_ns - silent_ns <= 5.1e9
    assert robot.run(1.0).v_m_s == pytest.approx(0.0, abs=0.01)
    x, _, _ = robot.pose()
    assert 0.3 < x - 6.0 < 3.7
    assert robot.state.message == "hold: the ground station is lost"
    beats = [m.custom_mode for m, _ in links.sent if m.get_type() == "HEARTBEAT"]
    assert beats[-1] == 4


@pytest.mark.parametrize(("charge", "ready"), [(0.9, True), (0.04, False)])
def test_the_pre_arm_bit_keeps_its_word(charge, ready):
    links = FakeLinks()
    robot = DrivenRobot(links, overrides=(f"simulation.battery.charge={charge}",), status_hz=10.0)
    robot.run(2.0)
    status = [m for m, _ in links.sent if m.get_type() == "SYS_STATUS"][-1]
    health = status.onboard_control_sensors_health
    assert bool(health & common.MAV_SYS_STATUS_PREARM_CHECK) is ready
    links.sent.clear()
    robot.command(ARM, 1)
    robot.run(1.5)
    acks = [m.result for m, _ in links.sent if m.get_type() == "COMMAND_ACK"]
    assert acks == [common.MAV_RESULT_ACCEPTED if ready else common.MAV_RESULT_DENIED]


@pytest.mark.parametrize("name", ["diff_drive", "ackermann"])
def test_a_mission_is_taken_and_driven_item_by_item(name):
    """Places are north and east, the robot's are x east and y north."""
    links = FakeLinks()
    robot = DrivenRobot(links, name, (6.0, 5.0, 0.0))
    robot.arm(HOLD)
    waypoint, local = common.MAV_CMD_NAV_WAYPOINT, common.MAV_FRAME_LOCAL_NED
    plan = [
        (waypoint, (0, 0, 0, 0), 0.0, 0.0),
        (waypoint, (1.5, 0, 0, 0), 5.0, 8.0),
        (common.MAV_CMD_DO_CHANGE_SPEED, (1, 0.2, -1, 0), 0.0, 0.0),
        (waypoint, (0, 0, 0, 0), 6.5, 9.0),
    ]
    robot.send(common.MAVLink_mission_count_message(1, 1, len(plan)))
    told = []
    for _ in range(200):
        robot.tick()
        sent, links.sent = links.sent, []
        for message, _ in sent:
            if message.get_type() == "MISSION_REQUEST_INT":
                command, params, north, east = plan[message.seq]
                place = round(1e4 * north), round(1e4 * east)
                robot.send(
                    common.MAVLink_mission_item_int_message(
                        1, 1, message.seq, local, command, 0, 1, *map(float, params), *place, 0.0
                    )
                )
            elif message.get_type() == "MISSION_ACK":
                told.append(message.type)
    assert told == [common.MAV_MISSION_ACCEPTED]
    assert robot.state.mode == HOLD  # a mission does not set the robot off
    robot.command(common.MAV_CMD_MISSION_START)
    nearest, fastest, reached, stood_s = math.inf, 0.0, [], 0.0
    for _ in range(200 * 40):
        control = robot.tick()
        x, y, _ = robot.pose()
        nearest = min(nearest, math.dist((x, y), (8.0, 5.0)))
        stood_s += 0.005 * (reached == [] and nearest < 0.1 and abs(control.v_m_s) < 0.01)
        if robot.state.item == 2:
            fastest = max(fastest, control.v_m_s)
        sent, links.sent = links.sent, []
        reached += [each.seq for each, _ in sent if each.get_type() == "MISSION_ITEM_REACHED"]
        if robot.state.mission_completed:
            break
    assert reached == [1, 3]
    assert nearest < 0.1
    assert stood_s > 1.3
    assert 0.15 < fastest < 0.23
    assert robot.pose()[:2] == pytest.approx((9.0, 6.5), abs=0.1)


def put(name, value):
    return common.MAVLink_param_set_message(1, 1, name.encode(), value, 9)


def test_a_lower_speed_limit_slows_a_driving_robot_down_at_once_and_without_a_jerk():
    robot = DrivenRobot(FakeLinks(), start=(6.0, 5.0, 0.0))
    robot.arm(GUIDED)
    drive = setpoint(common.MAV_FRAME_BODY_NED, VELOCITY, vx=0.6)
    assert robot.run(1.5, drive).v_m_s == pytest.approx(0.6, abs=0.03)
    robot.send(put("LIM_V_MAX", 0.3))
    references = []
    for number in range(200):
        if number % 20 == 0:
            robot.send(drive)
        references.append(robot.tick().v_ref_m_s)
    limits = robot.config.limits
    slopes = [(b - a) * 200 for a, b in itertools.pairwise(references)]
    assert min(slopes) >= -1.001 * limits.a_max_m_s2
    assert robot.run(0.5, drive).v_m_s == pytest.approx(0.3, abs=0.03)
    robot.send(put("LIM_V_MAX", 5.0))  # after a restart; until then that of the start
    assert robot.run(1.5, drive).v_m_s == pytest.approx(0.6, abs=0.03)


def test_gains_change_while_the_robot_drives_and_no_duty_jumps():
    robot = DrivenRobot(FakeLinks(), start=(6.0, 5.0, 0.0))
    robot.arm(GUIDED)
    drive = setpoint(common.MAV_FRAME_BODY_NED, VELOCITY, vx=0.4)
    robot.run(2.0, drive)

    def duties(seconds):
        return [robot.run(0.005, drive).duty[0] for _ in range(round(200 * seconds))]

    before = duties(0.5)
    for name, value in (("KP", 1.3), ("KI", 9.0), ("KV", 0.2), ("KS", 0.0)):
        robot.send(put(f"CTL_L_{name}", value))
    after = duties(1.0)
    steps = [abs(b - a) for a, b in itertools.pairwise(before)]
    jumps = [abs(b - a) for a, b in itertools.pairwise((before[-1], *after))]
    # Twice the gain answers an encoder's noise twice as much.
    assert max(jumps) <= 2.5 * max(steps)
    assert robot.stack.core.snapshot(0, robot.stack.statistics()).tuning != 0
    assert robot.run(0.5, drive).v_m_s == pytest.approx(0.4, abs=0.02)


def test_a_cruise_speed_counts_from_the_next_goal_on():
    robot = DrivenRobot(FakeLinks(), start=(4.0, 5.0, 0.0))
    robot.arm(GUIDED)
    goal = setpoint(common.MAV_FRAME_BODY_OFFSET_NED, POSITION, x=4.0)
    robot.send(goal)
    assert robot.run(2.0).v_m_s == pytest.approx(0.4, abs=0.03)
    robot.send(put("CRUISE_SPEED", 0.2))
    assert robot.run(1.0).v_m_s == pytest.approx(0.4, abs=0.03)
    robot.send(goal)
    assert robot.run(2.0).v_m_s == pytest.approx(0.2, abs=0.03)


def test_the_yaw_stick_to_the_right_moves_a_mecanum_robot_to_the_right():
    robot = DrivenRobot(FakeLinks(), "mecanum", (6.0, 5.0, NORTH_EAST))
    robot.arm(MANUAL)
    ahead, left, turn = moved(robot, 1.5, sticks(r=500))
    assert left < -0.2
    assert abs(ahead) < 0.05
    assert abs(turn) < 0.05
    ahead, left, _ = moved(robot, 1.5, sticks(z=300, r=-500))
    assert ahead > 0.1
    assert left > 0.1
