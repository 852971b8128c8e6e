"""Rates of periodic messages: configured, asked for by a peer, and over."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.mavlink.config import StreamRates
from robotctl.messages.control import (
    BatteryFeedback,
    BusStatus,
    LoopStatistics,
)
from robotctl.messages.mavlink_port import Peer

STREAMS = (
    "ATTITUDE",
    "LOCAL_POSITION_NED",
    "ODOMETRY",
    "WHEEL_DISTANCE",
    "DISTANCE_SENSOR",
    "BATTERY_STATUS",
    "SYS_STATUS",
)


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
