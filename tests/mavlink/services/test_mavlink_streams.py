"""Heartbeat and periodic messages, read back by pymavlink as a ground station does."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common
from scipy.spatial.transform import Rotation

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.mavlink.config import StreamRates
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.services.telemetry.system_status import Found, system_status
from robotctl.messages.control import (
    BatteryFeedback,
    BusStatus,
    ImuFeedback,
    LoopStatistics,
    Mode,
    Notice,
    SafetyState,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.mavlink_port import Peer
from robotctl.model.sensors.sonar import SonarMount
from tests.mavlink.conftest import control_state

STREAMS = (
    "ATTITUDE",
    "LOCAL_POSITION_NED",
    "ODOMETRY",
    "WHEEL_DISTANCE",
    "DISTANCE_SENSOR",
    "BATTERY_STATUS",
    "SYS_STATUS",
)


def one_of_each(bench, **control):
    """Return the first message of each name after half a second."""
    bench.run(0.5, **control)
    first = {}
    for message, _ in bench.take():
        first.setdefault(message.get_type(), message)
    return first


def test_heartbeat_says_ardupilot_rover_and_comes_once_a_second(bench):
    bench.run(10.0)
    beats = bench.messages("HEARTBEAT")
    assert len(beats) == 10
    assert beats[0].type == common.MAV_TYPE_GROUND_ROVER
    assert beats[0].autopilot == common.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert beats[0].base_mode & common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert beats[0].get_srcSystem() == 1


@pytest.mark.parametrize(
    ("state", "mav_state", "armed"),
    [
        (SafetyState.BOOT, common.MAV_STATE_BOOT, False),
        (SafetyState.STANDBY, common.MAV_STATE_STANDBY, False),
        (SafetyState.ARMED, common.MAV_STATE_ACTIVE, True),
        (SafetyState.DRIVING, common.MAV_STATE_ACTIVE, True),
        (SafetyState.FAULT, common.MAV_STATE_CRITICAL, False),
        (SafetyState.EMERGENCY_STOP, common.MAV_STATE_EMERGENCY, False),
    ],
)
def test_each_safety_state_has_its_mav_state_and_armed_flag(bench, state, mav_state, armed):
    bench.step(bench.control(state=state))
    beat = bench.messages("HEARTBEAT")[0]
    assert beat.system_status == mav_state
    assert bool(beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED) == armed


def test_a_heartbeat_goes_out_at_once_when_the_robot_is_armed_or_changes_its_mode(bench):
    bench.step(bench.control(state=SafetyState.STANDBY), bench.navigation(mode=Mode.HOLD))
    bench.take()
    for state, mode in (
        (SafetyState.ARMED, Mode.HOLD),
        (SafetyState.ARMED, Mode.AUTO),
        (SafetyState.FAULT, Mode.HOLD),
    ):
        for count in (1, 0, 0):
            bench.step(bench.control(state=state), bench.navigation(mode=mode))
            beats = bench.messages("HEARTBEAT")
            assert len(beats) == count
            armed = [bool(beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED) for beat in beats]
            assert armed == [state is SafetyState.ARMED] * count
            assert [beat.custom_mode for beat in beats] == [mode] * count


def test_half_a_second_after_the_last_word_of_control_the_state_is_critical(bench):
    bench.run(1.5, state=SafetyState.DRIVING)
    bench.take()
    silent_ns, beats = bench.now_ns, []
    while not (beats and beats[-1].system_status == common.MAV_STATE_CRITICAL):
        bench.step()
        beats += bench.messages("HEARTBEAT")
    assert 0.5e9 < bench.now_ns - silent_ns <= 0.54e9
    assert not beats[-1].base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED


@pytest.mark.parametrize(
    ("mode", "number"),
    [(Mode.MANUAL, 0), (Mode.HOLD, 4), (Mode.AUTO, 10), (Mode.RTL, 11), (Mode.GUIDED, 15)],
)
def test_each_mode_has_its_ardurover_number(bench, mode, number):
    bench.step(bench.navigation(mode=mode))
    assert bench.messages("HEARTBEAT")[0].custom_mode == number


def test_before_control_is_heard_the_state_is_boot_and_no_pose_is_sent(bench):
    for _ in range(100):
        bench.step()
    sent = bench.take()
    assert {message.get_type() for message, _ in sent} == {"HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME"}
    assert sent[0][0].system_status == common.MAV_STATE_BOOT


def test_when_control_falls_silent_the_state_is_critical_disarmed_and_the_pose_stops(bench):
    bench.run(1.0, state=SafetyState.DRIVING)
    for _ in range(60):
        bench.step()
    bench.take()
    for _ in range(60):
        bench.step()
    sent = bench.take()
    beat = next(message for message, _ in sent if message.get_type() == "HEARTBEAT")
    assert beat.system_status == common.MAV_STATE_CRITICAL
    assert not beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED
    names = {message.get_type() for message, _ in sent}
    assert names - {"CURRENT_EVENT_SEQUENCE"} == {"HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME"}
    status = next(message for message, _ in sent if message.get_type() == "SYS_STATUS")
    assert status.onboard_control_sensors_health == common.MAV_SYS_STATUS_GEOFENCE


def test_when_navigation_falls_silent_the_mode_is_hold(bench):
    bench.step(bench.navigation(mode=Mode.AUTO))
    bench.take()
    bench.run(2.5)
    assert bench.messages("HEARTBEAT")[-1].custom_mode == Mode.HOLD


def test_streams_come_at_their_configured_rates(make_bench):
    rates = StreamRates(attitude_hz=20.0, position_hz=5.0, odometry_hz=0.0, sonar_hz=2.0)
    bench = make_bench(rates=rates)
    bench.run(1.0)
    bench.take()
    bench.run(10.0)
    names = [message.get_type() for message, _ in bench.take()]
    counts = {name: names.count(name) for name in STREAMS}
    assert counts == {
        "ATTITUDE": 200,
        "LOCAL_POSITION_NED": 50,
        "ODOMETRY": 0,
        "WHEEL_DISTANCE": 50,
        "DISTANCE_SENSOR": 8 * 20,
        "BATTERY_STATUS": 10,
        "SYS_STATUS": 10,
    }


def test_a_pause_of_the_process_is_not_made_up_for_by_a_burst(bench):
    bench.run(1.0)
    bench.take()
    bench.step(advance_s=5.0)
    bench.run(0.5)
    assert len(bench.messages("ATTITUDE")) <= 6


def test_streams_do_not_all_fall_into_one_step(bench):
    most = 0
    for _ in range(200):
        bench.step(bench.control())
        most = max(most, len(bench.take()))
    assert most <= 8 + 4


def test_facing_north_east_and_turning_left_reads_as_yaw_45_and_negative_yaw_speed(bench):
    sent = one_of_each(bench, x_m=1.0, y_m=2.0, theta_rad=math.pi / 4, v_m_s=0.5, omega_rad_s=0.25)
    attitude = sent["ATTITUDE"]
    assert math.degrees(attitude.yaw) == pytest.approx(45.0, abs=1e-4)
    assert attitude.yawspeed == pytest.approx(-0.25)
    assert (attitude.roll, attitude.pitch) == (0.0, 0.0)
    position = sent["LOCAL_POSITION_NED"]
    assert (position.x, position.y, position.z) == pytest.approx((2.0, 1.0, 0.0))
    assert position.vx == pytest.approx(0.5 * math.sqrt(0.5))
    assert position.vy == pytest.approx(0.5 * math.sqrt(0.5))
    odometry = sent["ODOMETRY"]
    assert odometry.frame_id == common.MAV_FRAME_LOCAL_NED
    assert odometry.child_frame_id == common.MAV_FRAME_BODY_FRD
    assert (odometry.x, odometry.y) == pytest.approx((2.0, 1.0))
    half = math.radians(22.5)
    assert odometry.q == pytest.approx([math.cos(half), 0.0, 0.0, math.sin(half)])
    assert (odometry.vx, odometry.vy) == pytest.approx((0.5, 0.0))
    assert odometry.yawspeed == pytest.approx(-0.25)
    assert math.isnan(odometry.pose_covariance[0])


def test_time_stamps_are_those_of_the_state(bench):
    bench.step(bench.control())
    stamp_ns = bench.now_ns
    assert bench.messages("ATTITUDE")[0].time_boot_ms == stamp_ns // 1_000_000


def test_wheel_distances_are_those_of_the_driven_wheels(bench):
    message = one_of_each(bench)["WHEEL_DISTANCE"]
    assert message.count == 2
    assert message.distance[:3] == [3.5, 4.5, 0.0]


def test_the_odometry_reset_counter_counts_restarts_of_control(bench):
    bench.step(bench.control(odom_epoch_ns=1))
    bench.run(0.1, odom_epoch_ns=1)
    assert {message.reset_counter for message in bench.messages("ODOMETRY")} == {0}
    bench.run(0.5, odom_epoch_ns=2)
    assert {message.reset_counter for message in bench.messages("ODOMETRY")} == {1}


def test_each_sonar_has_a_message_with_its_number_and_orientation(bench):
    bench.run(0.3, sonar_m=(1.0, math.inf, math.nan, 0.125, 1.0, 1.0, 1.0, 9.0))
    sensors = {message.id: message for message in bench.messages("DISTANCE_SENSOR")}
    assert set(sensors) == {0, 1, 3, 4, 5, 6, 7}  # 2 is faulty
    assert sensors[0].orientation == common.MAV_SENSOR_ROTATION_NONE
    assert sensors[1].orientation == common.MAV_SENSOR_ROTATION_YAW_315  # 45 to the left
    assert sensors[6].orientation == common.MAV_SENSOR_ROTATION_YAW_90  # right
    assert sensors[0].current_distance == 100
    assert sensors[1].current_distance == sensors[1].max_distance + 1  # no echo
    assert sensors[3].current_distance == 12
    assert sensors[7].current_distance == 900
    assert sensors[0].type == common.MAV_DISTANCE_SENSOR_ULTRASOUND


def test_a_sonar_tells_the_range_and_the_beam_of_the_robots_file(make_bench):
    sonar = SonarModelConfig(max_range_m=2.5, beam_deg=15.0)
    bench = make_bench(sonar=sonar)
    bench.run(0.3, sonar_m=(1.0, math.inf))
    heard, silent = bench.messages("DISTANCE_SENSOR")[:2]
    assert (heard.min_distance, heard.max_distance, heard.current_distance) == (0, 250, 100)
    assert (silent.max_distance, silent.current_distance) == (250, 251)
    assert heard.horizontal_fov == pytest.approx(math.radians(15.0))
    assert heard.vertical_fov == pytest.approx(math.radians(15.0))


def test_a_sonar_without_echo_is_told_whatever_range_the_file_gives_it(make_bench):
    bench = make_bench(sonar=SonarModelConfig(max_range_m=1e6))
    bench.run(0.3, sonar_m=(math.inf,))
    sensor = bench.messages("DISTANCE_SENSOR")[0]
    assert (sensor.max_distance, sensor.current_distance) == (0xFFFE, 0xFFFF)


def test_a_sonar_at_an_odd_angle_sends_its_quaternion(make_bench):
    bench = make_bench(sonars=(SonarMount("odd", 0.0, 0.0, -60.0),))
    bench.run(0.3, sonar_m=(1.0,), sonar_stamp_ns=(0,))
    sensor = bench.messages("DISTANCE_SENSOR")[0]
    assert sensor.orientation == common.MAV_SENSOR_ROTATION_CUSTOM
    assert sensor.quaternion == pytest.approx([math.sqrt(0.75), 0.0, 0.0, 0.5])


def test_battery_and_system_status_show_the_battery(bench):
    sent = one_of_each(bench)
    battery = sent["BATTERY_STATUS"]
    assert battery.voltages[0] == 12345
    assert battery.voltages[1] == 0xFFFF
    assert (battery.current_battery, battery.battery_remaining) == (150, 80)
    assert battery.temperature == 3125
    assert battery.charge_state == common.MAV_BATTERY_CHARGE_STATE_OK
    status = sent["SYS_STATUS"]
    assert (status.voltage_battery, status.current_battery) == (12345, 150)
    assert status.battery_remaining == 80


@pytest.mark.parametrize(
    ("low", "critical", "expected"),
    [
        (True, False, common.MAV_BATTERY_CHARGE_STATE_LOW),
        (True, True, common.MAV_BATTERY_CHARGE_STATE_CRITICAL),
    ],
)
def test_a_low_battery_is_said(bench, low, critical, expected):
    battery = BatteryFeedback(0, 10.0, 1.0, 0.1, 20.0, low=low, critical=critical)
    sent = one_of_each(bench, battery=battery)
    assert sent["BATTERY_STATUS"].charge_state == expected
    healthy = sent["SYS_STATUS"].onboard_control_sensors_health
    assert bool(healthy & common.MAV_SYS_STATUS_SENSOR_BATTERY) != critical


def test_without_a_battery_its_values_are_unknown(bench):
    sent = one_of_each(bench, battery=None)
    assert "BATTERY_STATUS" not in sent
    assert sent["SYS_STATUS"].voltage_battery == 0xFFFF
    assert sent["SYS_STATUS"].battery_remaining == -1


def test_system_status_shows_load_and_errors_of_bus_and_loop(bench):
    bus = BusStatus(
        received=990, lost=10, crc_rejects=3, counter_rejects=4, error_frames=5, send_failures=6
    )
    loop = LoopStatistics(rate_hz=200.0, step_us_p50=500.0, overruns=7)
    status = one_of_each(bench, bus=bus, loop=loop)["SYS_STATUS"]
    assert status.load == 100  # 500 us of 5 ms
    assert status.drop_rate_comm == 100  # 1 %
    assert status.errors_comm == 17
    counts = status.errors_count1, status.errors_count2, status.errors_count3
    assert counts == (5, 6, 7)


def test_a_fault_makes_the_motors_unhealthy(bench):
    motors = common.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    bench.run(0.5, state=SafetyState.STANDBY)
    assert bench.messages("SYS_STATUS")[0].onboard_control_sensors_health & motors
    bench.run(1.5, state=SafetyState.FAULT)
    assert not bench.messages("SYS_STATUS")[-1].onboard_control_sensors_health & motors


def sensors(bench, bit, **control):
    """Return whether a part is present, enabled and healthy after a second."""
    bench.run(1.02, **control)
    status = bench.messages("SYS_STATUS")[-1]
    names = ("present", "enabled", "health")
    return tuple(bool(getattr(status, f"onboard_control_sensors_{name}") & bit) for name in names)


LOW = Fault(FaultCode.BATTERY_LOW, "the battery is low")


@pytest.mark.parametrize(
    ("state", "against", "healthy"),
    [
        (SafetyState.STANDBY, (), True),
        (SafetyState.STANDBY, (LOW,), False),
        (SafetyState.FAULT, (LOW,), False),
        (SafetyState.ARMED, (), True),
        (SafetyState.DRIVING, (), True),
    ],
)
def test_the_pre_arm_bit_says_whether_arming_would_succeed(bench, state, against, healthy):
    prearm = common.MAV_SYS_STATUS_PREARM_CHECK
    found = sensors(bench, prearm, state=state, against_arming=against)
    assert found == (True, True, healthy)


def test_no_fence_is_breached_where_there_is_none(bench):
    assert sensors(bench, common.MAV_SYS_STATUS_GEOFENCE) == (False, False, True)


def test_the_pose_is_healthy_while_it_is_known(bench):
    ahrs = common.MAV_SYS_STATUS_AHRS
    assert sensors(bench, ahrs) == (True, True, True)
    assert sensors(bench, ahrs, theta_rad=math.nan) == (True, True, False)


@pytest.mark.parametrize("mode", Mode)
def test_the_guard_is_enabled_in_the_modes_in_which_it_slows_the_robot(bench, mode):
    guard = common.MAV_SYS_STATUS_OBSTACLE_AVOIDANCE
    for _ in range(60):
        bench.step(bench.control(), bench.navigation(mode=mode))
    status = bench.messages("SYS_STATUS")[-1]
    is_enabled = bool(status.onboard_control_sensors_enabled & guard)
    assert is_enabled == (mode not in {Mode.HOLD, Mode.MANUAL})
    deaf = (math.nan, *[1.0] * 7)
    assert sensors(bench, guard, sonar_m=deaf)[2] is False


ANYTHING = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=60, deadline=None)
@given(numbers=st.lists(ANYTHING, min_size=30, max_size=30), counts=st.integers(0, 2**70))
def test_no_state_can_stop_telemetry(make_bench, numbers, counts):
    """Values that fit no field are clamped, marked unknown or left out; packing never fails."""
    n = iter(numbers)
    bench = make_bench()
    bench.run(
        1.2,
        x_m=next(n),
        y_m=next(n),
        theta_rad=next(n),
        v_m_s=next(n),
        omega_rad_s=next(n),
        distance_m=next(n),
        wheel_distance_m=tuple(next(n) for _ in range(2)),
        sonar_m=tuple(next(n) for _ in range(8)),
        sonar_stamp_ns=tuple(counts for _ in range(8)),
        battery=BatteryFeedback(0, next(n), next(n), next(n), next(n), low=True, critical=False),
        bus=BusStatus(received=counts, lost=counts, error_frames=counts, send_failures=counts),
        loop=LoopStatistics(rate_hz=next(n), step_us_p50=next(n), overruns=counts),
    )
    assert bench.messages("SYS_STATUS")


ONE, OTHER = Peer(0, 0), Peer(0, 1)
HEARTBEAT = common.MAVLink_heartbeat_message(common.MAV_TYPE_GCS, 8, 0, 0, 4, 3)


def interval_of(bench, message_id, peer=ONE):
    """Return the interval that a peer is told [us]."""
    bench.command(common.MAV_CMD_GET_MESSAGE_INTERVAL, message_id, peer=peer)
    bench.step()
    (told,) = bench.messages("MESSAGE_INTERVAL")
    return told.interval_us


@pytest.mark.parametrize("other", [OTHER, Peer(1, 0)], ids=["of its link", "of another link"])
def test_an_interval_holds_for_the_peer_that_asked_for_it_alone(make_bench, other):
    bench = make_bench()
    bench.links.clients = (ONE, other)
    bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 50_000, peer=other)
    bench.run(1.0)
    assert bench.messages("COMMAND_ACK")[0].result == common.MAV_RESULT_ACCEPTED
    bench.run(8.0)
    peers = [target for _, target in bench.take("ATTITUDE")]
    assert (peers.count(ONE), peers.count(other)) == (80, 160)
    assert (interval_of(bench, 30, ONE), interval_of(bench, 30, other)) == (100_000, 50_000)


def test_a_rate_ends_with_the_connection_of_the_peer_that_asked_for_it(bench):
    bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1)
    bench.run(1.0)
    assert bench.messages("ATTITUDE") == []
    bench.links.clients = ()
    bench.run(0.1)
    bench.links.clients = (OTHER,)
    bench.run(1.0)
    assert len(bench.messages("ATTITUDE")) == 10


def test_a_rate_ends_when_its_peer_falls_silent_and_lasts_while_it_does_not(bench):
    bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1)
    for _ in range(12):
        bench.receive(HEARTBEAT)
        bench.run(1.0)
    assert bench.messages("ATTITUDE") == []
    bench.run(8.9)
    assert bench.messages("ATTITUDE") == []
    bench.run(1.2)
    assert len(bench.messages("ATTITUDE")) >= 9


def test_the_interval_of_the_heartbeat_is_told_and_is_one_second(bench):
    assert interval_of(bench, 0) == 1_000_000
    for asked_us, result in ((1_000_000, 0), (0, 0), (500_000, 2), (-1, 2)):
        bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 0, asked_us)
        bench.step()
        assert bench.messages("COMMAND_ACK")[0].result == result


def ask_for_group(bench, group, rate_hz, start=1, peer=ONE):
    bench.receive(
        common.MAVLink_request_data_stream_message(1, 1, group, rate_hz, start), peer=peer
    )


def counts_of(bench, seconds):
    """Return how often each stream comes."""
    bench.take()
    bench.receive(HEARTBEAT)
    bench.run(seconds)
    names = [message.get_type() for message, _ in bench.take()]
    return {name: names.count(name) for name in STREAMS}


def test_a_data_stream_is_the_group_of_messages_that_ardupilot_has_in_it(bench):
    before = counts_of(bench, 5.0)
    ask_for_group(bench, common.MAV_DATA_STREAM_EXTRA1, 20)
    assert counts_of(bench, 5.0) == before | {"ATTITUDE": 100}
    ask_for_group(bench, common.MAV_DATA_STREAM_POSITION, 2)
    ask_for_group(bench, common.MAV_DATA_STREAM_EXTENDED_STATUS, 0)
    now = before | {"ATTITUDE": 100, "LOCAL_POSITION_NED": 10, "SYS_STATUS": 0}
    assert counts_of(bench, 5.0) == now
    ask_for_group(bench, common.MAV_DATA_STREAM_ALL, 4)
    in_groups = dict.fromkeys(STREAMS, 20) | {"DISTANCE_SENSOR": 160}
    assert counts_of(bench, 5.0) == in_groups | {"ODOMETRY": before["ODOMETRY"]}
    ask_for_group(bench, common.MAV_DATA_STREAM_ALL, 4, start=0)
    stopped = dict.fromkeys(STREAMS, 0)
    assert counts_of(bench, 5.0) == stopped | {"ODOMETRY": before["ODOMETRY"]}


def test_a_data_stream_asked_for_again_and_again_comes_no_more_often(bench):
    for _ in range(100):
        ask_for_group(bench, common.MAV_DATA_STREAM_ALL, 4)
        bench.step(bench.control())
    assert len(bench.messages("ATTITUDE")) <= 9


def test_the_interval_of_a_message_that_comes_only_on_request_is_off(bench):
    assert interval_of(bench, common.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == -1


@pytest.mark.parametrize(
    ("interval_us", "count"), [(-1, 0), (0, 100), (1_000_000, 10), (1, 500), (500_000, 20)]
)
def test_intervals_may_be_off_default_or_clamped_to_what_steps_allow(bench, interval_us, count):
    bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 30, interval_us)
    bench.run(1.0)
    bench.take()
    bench.receive(HEARTBEAT)
    bench.run(10.0)
    assert len(bench.messages("ATTITUDE")) == count


@pytest.mark.parametrize(
    "params",
    [
        (124, 1000),
        (math.nan, 1000),
        (30, math.nan),
        (30.5, 1000),
        (30, -2),
        (30, 2**31),
        (30, 3e9),
        (30, 1e12),
    ],
)
def test_intervals_of_foreign_messages_and_nonsense_are_denied(bench, params):
    bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, *params)
    bench.step()
    assert bench.messages("COMMAND_ACK")[0].result == common.MAV_RESULT_DENIED


def test_the_interval_can_be_asked_for(bench):
    bench.command(common.MAV_CMD_GET_MESSAGE_INTERVAL, 30)
    bench.command(common.MAV_CMD_GET_MESSAGE_INTERVAL, 124)
    bench.command(common.MAV_CMD_GET_MESSAGE_INTERVAL, -5)
    bench.step()
    sent = bench.take()
    intervals = [m.interval_us for m, _ in sent if m.get_type() == "MESSAGE_INTERVAL"]
    results = [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"]
    assert intervals == [100_000, 0]
    assert results == [0, 0, common.MAV_RESULT_DENIED]


def test_the_longest_interval_can_be_asked_for(bench):
    longest_us = 2**31 - 128  # the last 32 bit float that a signed 32 bit integer holds
    bench.command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 30, longest_us)
    bench.command(common.MAV_CMD_GET_MESSAGE_INTERVAL, 30)
    bench.step()
    assert [m.interval_us for m in bench.messages("MESSAGE_INTERVAL")] == [longest_us]


def test_long_notices_go_out_in_chunks_that_the_definition_asks_for(bench):
    text = "".join(chr(ord("a") + i % 26) for i in range(100))
    bench.step(Notice(0, 3, "short"), Notice(0, 4, text), Notice(0, 99, "\u00e9"))
    sent = bench.messages("STATUSTEXT")
    assert [(m.severity, m.text, m.chunk_seq) for m in sent] == [
        (3, "short", 0),
        (4, text[:50], 0),
        (4, text[50:], 1),
        (4, "", 2),  # 100 is a multiple of 50: an empty chunk ends the text
        (7, "?", 0),
    ]
    assert sent[0].id == 0
    assert {m.id for m in sent[1:4]} == {sent[1].id} != {0}


def test_a_flood_of_notices_is_spread_and_the_oldest_are_dropped(bench):
    bench.step(*[Notice(0, 6, str(number)) for number in range(200)])
    assert len(bench.texts()) == 4
    bench.run(1.0)
    assert bench.texts()[-1] == "199"


NOSE_UP_DEG, LEFT_UP_DEG = 12.0, 5.0


def tilted(**changes):
    """What the IMU of a robot says that stands nose up and left side up, and turns left."""
    attitude = Rotation.from_euler("ZYX", [0.7, -NOSE_UP_DEG, LEFT_UP_DEG], degrees=True)
    up = attitude.inv().apply([0.0, 0.0, 1.0])
    values = {
        "stamp_ns": 5_000_000_000,
        "gyro_stamp_ns": 5_000_000_000,
        "rate_rad_s": (0.1, 0.2, 0.3),
        "force_m_s2": tuple(9.80665 * up),
        "up": tuple(up),
        "bias_rad_s": (0.01, 0.02, 0.03),
    }
    return ImuFeedback(**values | changes)


def test_the_imu_is_told_in_front_right_down(bench):
    message = one_of_each(bench, imu=tilted(force_m_s2=(1.0, 2.0, 9.80665)))["SCALED_IMU"]
    assert (message.xacc, message.yacc, message.zacc) == (102, -204, -1000)
    assert (message.xgyro, message.ygyro, message.zgyro) == (100, -200, -300)
    assert (message.xmag, message.ymag, message.zmag) == (0, 0, 0)
    assert message.time_boot_ms == 5000


def test_the_attitude_is_that_of_the_imu_and_its_rates_are_without_bias(bench):
    message = one_of_each(bench, imu=tilted(), theta_rad=0.7)["ATTITUDE"]
    assert math.degrees(message.roll) == pytest.approx(LEFT_UP_DEG, abs=1e-4)
    assert math.degrees(message.pitch) == pytest.approx(NOSE_UP_DEG, abs=1e-4)
    assert message.yaw == pytest.approx(math.pi / 2 - 0.7)
    assert message.rollspeed == pytest.approx(0.09)
    assert message.pitchspeed == pytest.approx(-0.18)
    assert message.yawspeed == pytest.approx(-0.27)


def test_odometry_has_the_same_attitude(bench):
    sent = one_of_each(bench, imu=tilted(), theta_rad=0.7)
    attitude, odometry = sent["ATTITUDE"], sent["ODOMETRY"]
    w, x, y, z = odometry.q
    yaw, pitch, roll = Rotation.from_quat([x, y, z, w]).as_euler("ZYX")
    told = attitude.roll, attitude.pitch, attitude.yaw
    assert told == pytest.approx((roll, pitch, yaw), abs=1e-6)
    assert (odometry.rollspeed, odometry.pitchspeed, odometry.yawspeed) == pytest.approx(
        (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)
    )


def test_a_robot_without_an_imu_is_level_and_tells_none(bench):
    sent = one_of_each(bench, omega_rad_s=0.4)
    assert "SCALED_IMU" not in sent
    attitude = sent["ATTITUDE"]
    assert (attitude.roll, attitude.pitch, attitude.rollspeed, attitude.pitchspeed) == (0, 0, 0, 0)
    assert attitude.yawspeed == pytest.approx(-0.4)


@pytest.mark.parametrize(("imu", "healthy"), [(tilted(), True), (None, False)])
def test_gyro_and_accelerometer_are_present_where_the_robot_has_them(imu, healthy):
    bits = common.MAV_SYS_STATUS_SENSOR_3D_GYRO | common.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    for has_imu in (False, True):
        robot = TelemetryRobot(has_imu=has_imu)
        (message,) = system_status(control_state(0, imu=imu), robot, Found(True, True, True))
        assert message.onboard_control_sensors_present & bits == (bits if has_imu else 0)
        expected = bits if has_imu and healthy else 0
        assert message.onboard_control_sensors_health & bits == expected
