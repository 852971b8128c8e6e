"""Going to a place: DO_REPOSITION and set-points on the globe, to points of `world`."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.globe import Origin
from robotctl.messages.control import Mode, PositionTarget, SafetyState, SetMode
from tests.mavlink.conftest import Bench

ORIGIN = Origin(48.0, 11.0)
GLOBAL, NED = m.MAV_FRAME_GLOBAL, m.MAV_FRAME_LOCAL_NED
ACCEPTED, BUSY, DENIED = (
    m.MAV_RESULT_ACCEPTED, m.MAV_RESULT_TEMPORARILY_REJECTED, m.MAV_RESULT_DENIED,
)  # fmt: skip
ARMED = {"state": SafetyState.ARMED}
GUIDED = {"mode": Mode.GUIDED}


@pytest.fixture
def placed(bench):
    """A bench whose map has an origin on the globe."""
    bench.receive(m.MAVLink_set_gps_global_origin_message(1, 480_000_000, 110_000_000, 0))
    bench.step(bench.control(), bench.navigation())
    bench.take()
    return bench


def go(bench, x, y, frame=GLOBAL, flags=1, yaw=math.nan, control=ARMED, navigation=GUIDED):
    """Send DO_REPOSITION to a place of `world`; return the requests and the answer."""
    if frame == NED:
        place = round(1e4 * y), round(1e4 * x)
    else:
        place = [round(1e7 * each) for each in ORIGIN.from_world(x, y)]
    command = m.MAV_CMD_DO_REPOSITION
    bench.receive(
        m.MAVLink_command_int_message(1, 1, frame, command, 0, 0, -1, flags, 0, yaw, *place, 0)
    )
    requests = bench.step(bench.control(**control), bench.navigation(**navigation))
    (ack,) = bench.messages("COMMAND_ACK")
    return requests, ack.result


@pytest.mark.parametrize("frame", [GLOBAL, m.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, NED])
def test_the_robot_goes_to_the_place_with_the_heading(placed, frame):
    (target,), result = go(placed, 4.0, -2.5, frame, yaw=math.pi / 2)
    assert result == ACCEPTED
    assert isinstance(target, PositionTarget)
    assert (target.x_m, target.y_m) == pytest.approx((4.0, -2.5), abs=0.02)
    assert target.heading_rad == pytest.approx(0.0, abs=1e-6)  # yaw 90 degrees is east


def test_any_heading_will_do_without_one(placed):
    (target,), _ = go(placed, 1.0, 1.0)
    assert target.heading_rad is None


def test_another_mode_is_left_only_where_that_is_asked_for(placed):
    hold = {"mode": Mode.HOLD}
    assert go(placed, 1.0, 1.0, flags=0, navigation=hold) == ([], DENIED)
    (mode, target), result = go(placed, 2.0, 1.0, navigation=hold)
    assert result == ACCEPTED
    assert isinstance(mode, SetMode)
    assert mode.mode is Mode.GUIDED
    assert isinstance(target, PositionTarget)


def test_a_robot_that_is_not_armed_is_not_set_off_later(placed):
    requests, result = go(placed, 1.0, 1.0, control={})
    assert (requests, result) == ([], BUSY)


def test_a_late_copy_does_not_set_a_robot_off_that_was_stopped(placed):
    (_,), result = go(placed, 1.0, 1.0)
    assert result == ACCEPTED
    assert go(placed, 1.0, 1.0) == ([], ACCEPTED)
    assert go(placed, 1.0, 1.0, navigation={"mode": Mode.HOLD}) == ([], BUSY)


def test_a_place_that_means_nothing_is_refused(bench):
    assert go(bench, 1.0, 1.0) == ([], 9)  # a frame that is not supported: there is no origin
    assert go(bench, 1.0, 2.0, frame=m.MAV_FRAME_BODY_NED) == ([], 9)
    bench.command(m.MAV_CMD_DO_REPOSITION, -1, 1, 0, math.nan, 48.0, 11.0)
    assert bench.step(bench.control(**ARMED), bench.navigation(**GUIDED)) == []
    assert [x.result for x in bench.messages("COMMAND_ACK")] == [m.MAV_RESULT_COMMAND_INT_ONLY]


def setpoint(x, y, frame=m.MAV_FRAME_GLOBAL_INT, mask=0xDF8, vx=0.0):
    place = [round(1e7 * each) for each in ORIGIN.from_world(x, y)]
    return m.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, *place, 0, vx, 0, 0, 0, 0, 0, 0, 0
    )


def test_a_set_point_on_the_globe_is_one_of_the_map(placed):
    placed.receive(setpoint(-3.0, 5.0))
    (target,) = placed.step(placed.control(**ARMED), placed.navigation(**GUIDED))
    assert (target.x_m, target.y_m) == pytest.approx((-3.0, 5.0), abs=0.02)
    placed.receive(setpoint(0.0, 0.0, mask=0xFC7, vx=0.5))  # a velocity to the north
    (target,) = placed.step(placed.control(**ARMED), placed.navigation(**GUIDED))
    assert (target.v_m_s, target.heading_rad) == pytest.approx((0.5, math.pi / 2))
    for bad in (setpoint(1.0, 1.0, frame=m.MAV_FRAME_LOCAL_NED), setpoint(1.0, 1.0, mask=0xDF9)):
        placed.receive(bad)
        assert placed.step(placed.control(**ARMED), placed.navigation(**GUIDED)) == []


def test_without_an_origin_a_set_point_on_the_globe_is_refused_and_that_is_said(bench):
    bench.receive(setpoint(1.0, 1.0))
    assert bench.step(bench.control(**ARMED), bench.navigation(**GUIDED)) == []
    assert "no origin" in "".join(bench.texts())


@given(st.lists(st.floats(), min_size=5, max_size=5))
def test_no_state_stops_a_robot_with_an_origin_from_telling_its_position(numbers):
    bench = Bench(origin=ORIGIN)
    x, y, theta, v, duty = numbers
    bench.run(1.0, x_m=x, y_m=y, theta_rad=theta, v_m_s=v, duty=(duty, 0.5))
    assert bench.messages("HEARTBEAT")
