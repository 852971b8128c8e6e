"""What few clients ask for: estimator, obstacles, time, wheels, and refusals with reasons."""

import math
import random
import struct

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.dialects.v20 import common as m

from robotctl.dialect import additions
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import (
    ImuFeedback,
    Mode,
    SafetyState,
    StepBudget,
    VelocityTarget,
)
from robotctl.messages.estimation import LidarScan, LocalisationState
from robotctl.messages.mavlink_port import Peer
from robotctl.model.geometry.localisation import LocalisationStatus
from tests.mavlink.conftest import SONAR, SONARS, Bench

ACCEPTED, DENIED, LATER = (
    m.MAV_RESULT_ACCEPTED, m.MAV_RESULT_DENIED, m.MAV_RESULT_TEMPORARILY_REJECTED,
)  # fmt: skip


def ask(bench, name, *states):
    """Return the messages of one name, asked for once."""
    bench.step(*(states or (bench.control(),)))
    bench.take()
    number = f"MAVLINK_MSG_ID_{name}"
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, getattr(additions, number, 0) or getattr(m, number))
    bench.step()
    return bench.messages(name)


def command(bench, number, *params, **states):
    """Return the result of a command, its requests and what is said."""
    control = bench.control(state=states.get("state", SafetyState.ARMED), theta_rad=math.pi / 2)
    bench.command(number, *params)
    requests = bench.step(control, bench.navigation(mode=states.get("mode", Mode.GUIDED)))
    sent = [each for each, _ in bench.take()]
    (result,) = [each.result for each in sent if each.get_type() == "COMMAND_ACK"]
    return result, requests, " ".join(x.text for x in sent if x.get_type() == "STATUSTEXT")


def test_a_quaternion_is_that_of_the_attitude(bench):
    state = bench.control(theta_rad=2.0)
    (quaternion,) = ask(bench, "ATTITUDE_QUATERNION", state)
    (attitude,) = ask(bench, "ATTITUDE", state)
    yaw = 2.0 * math.atan2(quaternion.q4, quaternion.q1)
    assert math.remainder(yaw - attitude.yaw, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_the_estimator_says_how_well_the_place_is_known(bench):
    (odometry,) = ask(bench, "ESTIMATOR_STATUS")
    assert odometry.flags & m.ESTIMATOR_POS_HORIZ_REL
    assert not odometry.flags & m.ESTIMATOR_POS_HORIZ_ABS
    assert math.isnan(odometry.pos_horiz_accuracy)
    bench.robot = described(has_localiser=True)
    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links)
    fix = LocalisationState(
        bench.now_ns, "mcl", LocalisationStatus.LOCALISED, 0.0, 0.0, 0.0,
        (0.09, 0.0, 0.0, 0.16, 0.0, 0.01),
    )  # fmt: skip
    (known,) = ask(bench, "ESTIMATOR_STATUS", bench.control(), fix)
    assert known.flags & m.ESTIMATOR_POS_HORIZ_ABS
    assert known.pos_horiz_accuracy == pytest.approx(0.5)


def test_ekf_and_gps_say_that_the_robot_is_armable_where_it_knows_its_place():
    """`is_armable` of dronekit: a fix of 2 or more, and EKF_PRED_POS_HORIZ_ABS."""

    def is_armable(bench, *states):
        (ekf,) = ask(bench, "EKF_STATUS_REPORT", *states)
        gps = ask(bench, "GPS_RAW_INT", *states)[-1]
        assert ekf.velocity_variance == ekf.pos_horiz_variance == 0.0
        assert (gps.fix_type > 1) == (gps.lat != 0)
        return gps.fix_type > 1 and bool(ekf.flags & dialect.EKF_PRED_POS_HORIZ_ABS)

    bench = Bench(origin=Origin(48.0, 11.0, 500.0))
    assert is_armable(bench, bench.control())
    bench.robot = described(has_localiser=True)
    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links)
    assert not is_armable(bench, bench.control())
    fix = LocalisationState(
        bench.now_ns + 10**8, "mcl", LocalisationStatus.LOCALISED, 0.0, 0.0, 0.0,
        (0.09, 0.0, 0.0, 0.16, 0.0, 0.01),
    )  # fmt: skip
    assert is_armable(bench, bench.control(), fix)
    gps = ask(bench, "GPS_RAW_INT", bench.control(), fix)[-1]
    assert gps.h_acc == 500  # mm
    nothing = Bench()
    nothing.run(2.0)
    assert nothing.messages("GPS_RAW_INT") == []


def test_shaking_is_the_force_about_its_mean(bench):
    assert ask(bench, "VIBRATION") == []
    rng = random.Random(1)
    for _ in range(400):
        force = (rng.gauss(0.2, 0.5), rng.gauss(0.0, 0.1), 9.81)
        bench.step(bench.control(imu=imu(bench.now_ns, force)))
    (shaking,) = ask(bench, "VIBRATION", bench.control(imu=imu(bench.now_ns, (0.2, 0.0, 9.81))))
    assert shaking.vibration_x == pytest.approx(0.5, rel=0.25)
    assert shaking.vibration_y == pytest.approx(0.1, rel=0.25)
    assert shaking.vibration_z == pytest.approx(0.0, abs=1e-3)
    for _ in range(400):
        bench.step(bench.control(imu=imu(bench.now_ns, (3.0, 0.0, 9.81))))
    (still,) = ask(bench, "VIBRATION", bench.control(imu=imu(bench.now_ns, (3.0, 0.0, 9.81))))
    assert still.vibration_x == pytest.approx(0.0, abs=1e-2)


def imu(now_ns, force):
    return ImuFeedback(now_ns, now_ns, (0.0, 0.0, 0.0), force, (0.0, 0.0, 1.0))


def test_outputs_are_the_duties_as_pulses(bench):
    (outputs,) = ask(bench, "SERVO_OUTPUT_RAW", bench.control(duty=(0.5, -1.0)))
    assert (outputs.servo1_raw, outputs.servo2_raw, outputs.servo3_raw) == (1750, 1000, 0)


def test_channels_are_those_that_steer_now(bench):
    (nothing,) = ask(bench, "RC_CHANNELS")
    assert (nothing.chancount, nothing.chan1_raw, nothing.chan3_raw) == (0, 65535, 65535)
    for steering, throttle in ((1500, 1900), (1100, 1600), (1700, 1500)):
        given = m.MAVLink_rc_channels_override_message(
            1, 1, steering, 65535, throttle, 65535, 65535, 65535, 65535, 65535
        )
        bench.receive(given)
        (told,) = ask(bench, "RC_CHANNELS")
        assert (told.chan1_raw, told.chan3_raw) == (steering, throttle)
        assert told.chancount == 3
    bench.run(1.0)
    (gone,) = ask(bench, "RC_CHANNELS")
    assert (gone.chancount, gone.chan1_raw) == (0, 65535)


def test_the_banner_is_told_to_who_asks_for_it(make_bench):
    bench = make_bench(links=2)
    bench.step(bench.control())
    bench.take()
    bench.command(dialect.MAV_CMD_DO_SEND_BANNER, peer=Peer(1, 0))
    bench.step(bench.control())
    sent = bench.take()
    told = {(each.text, to) for each, to in sent if each.get_type() == "STATUSTEXT"}
    assert told == {("robotctl V1.2.3", Peer(1, 0)), ("Robot tester", Peer(1, 0))}
    assert [e.result for e, _ in sent if e.get_type() == "COMMAND_ACK"] == [ACCEPTED]
    assert bench.telemetry.take_notices() == []


def test_what_ardupilots_dialect_does_not_know_comes_only_to_who_asks_for_it(make_bench):
    """Stations of that dialect, as MAVProxy and Mission Planner, count it as lost."""

    def live(bench, *peers):
        for mode in (Mode.HOLD, Mode.AUTO, Mode.HOLD):
            for state in (SafetyState.ARMED, SafetyState.FAULT):
                for _ in range(60):
                    bench.step(bench.control(state=state), bench.navigation(mode=mode))
        sent = bench.take()
        return [{each.get_msgId() for each, to in sent if to == peer} for peer in peers]

    bench, asking, other = make_bench(links=2), Peer(1, 0), Peer(0, 0)
    (seen,) = live(bench, other)
    assert len(seen) > 10
    assert not seen - dialect.mavlink_map.keys()
    for number in (410, 411, 435, 436):
        bench.command(m.MAV_CMD_REQUEST_MESSAGE, number, peer=asking)
    for number in (411, 436):
        bench.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6, peer=asking)
    here, there = live(bench, asking, other)
    assert {410, 411, 435, 436} <= here
    assert not there - dialect.mavlink_map.keys()
    (px4,) = live(make_bench(personality="px4"), other)
    assert {410, 411, 436} <= px4


def described(**changes):
    return TelemetryRobot("tester", "1.2.3", SONARS, SONAR, **changes)


def test_the_ring_holds_what_sonars_and_lidar_see_clockwise_from_ahead(bench):
    nothing, unseen = round(SONAR.max_range_m * 100) + 1, 65535
    ranges = (1.0, math.inf, math.nan, 2.0, 2.0, 2.0, 0.5, 2.0)  # ahead; left: 45, 90, ...
    (ring,) = ask(bench, "OBSTACLE_DISTANCE", bench.control(sonar_m=ranges))
    assert ring.sensor_type == m.MAV_DISTANCE_SENSOR_ULTRASOUND
    assert (ring.increment, ring.frame) == (5, m.MAV_FRAME_BODY_FRD)
    assert ring.distances[0] == pytest.approx(110, abs=1)  # the mounts are 0.1 m before `base`
    assert ring.distances[72 - 9] == nothing  # 45 degrees to the left
    assert ring.distances[72 - 18] == unseen
    assert min(ring.distances[15:20]) == pytest.approx(51, abs=3)  # 90 degrees to the right
    beams = [math.inf] * 360
    beams[90] = 2.0  # to the left
    scan = LidarScan(
        bench.now_ns, 0.0, 0.0, 0.0, math.radians(1.0), 8.0, struct.pack("<360f", *beams)
    )
    (ring,) = ask(bench, "OBSTACLE_DISTANCE", bench.control(), scan)
    assert ring.sensor_type == m.MAV_DISTANCE_SENSOR_LASER
    assert ring.distances[54] == 200
    assert sum(each == 801 for each in ring.distances) == 71
    ahead = [math.nan] * 360
    ahead[0] = 1.0
    other = msgspec.structs.replace(scan, ranges=struct.pack("<360f", *ahead), name="front")
    (ring,) = ask(bench, "OBSTACLE_DISTANCE", bench.control(), other)
    assert (ring.distances[0], ring.distances[54]) == (100, 200)  # of both lidars


def test_time_wheels_and_the_globe_are_told():
    bench = Bench(origin=Origin(48.0, 11.0, 500.0))
    bench.telemetry._context.wall_ns = lambda: 1_700_000_000_123_456_789
    bench.run(2.5)
    times = bench.messages("SYSTEM_TIME")
    assert [each.time_unix_usec for each in times][:1] == [1_700_000_000_123_456]
    assert len(times) in {2, 3}
    first, second = ask(bench, "RAW_RPM", bench.control(wheel_rad_s=(math.pi, -math.tau)))
    assert (first.index, second.index) == (0, 1)
    assert (first.frequency, second.frequency) == pytest.approx((30.0, -60.0))
    (gps,) = ask(bench, "GPS_RAW_INT")
    assert (gps.fix_type, gps.satellites_visible) == (m.GPS_FIX_TYPE_3D_FIX, 255)
    assert gps.lat == pytest.approx(480_000_180, abs=20)
    bench.take()
    bench.command(m.MAV_CMD_GET_HOME_POSITION)
    bench.step()
    assert len(bench.messages("HOME_POSITION")) == 1


def test_the_times_of_navigations_steps_are_told_by_part(bench):
    budget = StepBudget(50.0, 400, 3, 9.0, 21.5, {"see": 1.0}, {"localise": 12.25, "steer": 17.0})
    bench.step(bench.control(), bench.navigation(budget=budget))
    values = ask(bench, "NAMED_VALUE_FLOAT", bench.control(), bench.navigation(budget=budget))
    told = {each.name: each.value for each in values}
    assert told == {"n_step": 21.5, "n_localise": 12.25, "n_steer": 17.0}
    assert ask(bench, "NAMED_VALUE_FLOAT", bench.control(), bench.navigation()) == []


def test_a_ping_comes_back_to_who_has_sent_it_and_answers_do_not(bench):
    bench.receive(m.MAVLink_ping_message(12345, 7, 0, 0), system=200)
    bench.receive(m.MAVLink_ping_message(12345, 8, 1, 1), system=200)
    bench.step()
    (answer,) = bench.messages("PING")
    assert (answer.time_usec, answer.seq) == (12345, 7)
    assert (answer.target_system, answer.target_component) == (200, 190)


def test_a_yaw_and_a_speed_are_followed_in_guided_alone(bench):
    number = m.MAV_CMD_NAV_SET_YAW_SPEED
    result, (request,), _ = command(bench, number, 90.0, 0.3, 0.0)
    assert result == ACCEPTED
    assert isinstance(request, VelocityTarget)
    assert request.v_m_s == pytest.approx(0.3)
    assert request.heading_rad == pytest.approx(0.0, abs=1e-9)  # east
    _, (request,), _ = command(bench, number, 90.0, 0.3, 1.0)
    assert math.remainder(request.heading_rad, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert command(bench, number, math.nan, 0.3)[:2] == (DENIED, [])
    assert command(bench, number, 0.0, 0.3, mode=Mode.HOLD)[:2] == (LATER, [])
    assert command(bench, number, 0.0, 0.3, state=SafetyState.STANDBY)[:2] == (LATER, [])


def test_the_way_to_the_goal_is_told_while_there_is_one(bench):
    bench.step(bench.control(), bench.navigation(goal=(5.0, 5.0)))
    bench.take()
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT)
    bench.step(bench.control(x_m=2.0, y_m=1.0), bench.navigation(goal=(5.0, 5.0)))
    (output,) = bench.messages("NAV_CONTROLLER_OUTPUT")
    assert (output.target_bearing, output.wp_dist) == (37, 5)  # 3 m east, 4 m north
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT)
    bench.step(bench.control(), bench.navigation())
    assert bench.messages("NAV_CONTROLLER_OUTPUT") == []


def test_what_is_known_of_the_battery_is_told_and_the_rest_is_marked_unknown(bench):
    (info,) = ask(bench, "BATTERY_INFO")
    assert (info.id, info.battery_function) == (0, m.MAV_BATTERY_FUNCTION_ALL)
    assert (info.name, info.serial_number, info.manufacture_date) == ("battery of tester", "", "")
    assert (info.state_of_health, info.cycle_count) == (255, 65535)
    assert (info.cells_in_series, info.nominal_voltage, info.design_capacity) == (0, 0.0, 0.0)
    assert ask(bench, "BATTERY_INFO", bench.control(battery=None)) == []
