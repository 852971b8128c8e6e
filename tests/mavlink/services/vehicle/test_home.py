"""DO_SET_HOME: where RTL leads to, asked for and told."""

import math

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.command import UNSUPPORTED_FRAME
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Mode, SetHome
from tests.mavlink.conftest import Bench

ORIGIN = Origin(48.0, 11.0)
ACCEPTED, BUSY, DENIED = (
    m.MAV_RESULT_ACCEPTED, m.MAV_RESULT_TEMPORARILY_REJECTED, m.MAV_RESULT_DENIED,
)  # fmt: skip


@pytest.fixture
def placed():
    """A bench whose map has an origin on the globe."""
    return Bench(origin=ORIGIN)


def ask(bench, *params, x=0, y=0, frame=m.MAV_FRAME_GLOBAL, mode=Mode.HOLD):
    """Send a COMMAND_INT; return the requests, the result and what is said."""
    params = (*params, *[0.0] * (4 - len(params)))
    number = m.MAV_CMD_DO_SET_HOME
    bench.receive(m.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *params, x, y, 0))
    control = bench.control(x_m=3.0, y_m=-1.0, theta_rad=0.5)
    requests = bench.step(control, bench.navigation(mode=mode))
    sent = [each for each, _ in bench.take()]
    (ack,) = (each for each in sent if each.get_type() == "COMMAND_ACK")
    said = " ".join(each.text for each in sent if each.get_type() == "STATUSTEXT")
    return requests, ack.result, said


def test_home_is_where_the_robot_is(bench):
    (request,), result, _ = ask(bench, 1)
    assert result == ACCEPTED
    assert isinstance(request, SetHome)
    assert (request.x_m, request.y_m, request.theta_rad) == (3.0, -1.0, 0.5)


def test_home_is_a_place_on_the_globe(placed):
    latitude, longitude = (round(1e7 * each) for each in ORIGIN.from_world(12.0, 7.0))
    (request,), result, _ = ask(placed, 0, 0, 0, 90.0, x=latitude, y=longitude)
    assert result == ACCEPTED
    assert (request.x_m, request.y_m) == pytest.approx((12.0, 7.0), abs=0.02)
    assert request.theta_rad == pytest.approx(0.0, abs=1e-9)  # yaw 90 degrees is east
    (request,), _, _ = ask(placed, 0, 0, 0, math.nan, x=latitude, y=longitude)
    assert request.theta_rad == 0.5  # without one it is that of the robot


def test_what_cannot_be_home_is_refused_with_the_reason(bench, placed):
    assert ask(bench, 2)[1:] == (DENIED, "Home: param1 is 2, 0 or 1 allowed")
    requests, result, said = ask(bench, 0, x=480_000_000, y=110_000_000)  # without an origin
    assert (requests, result) == ([], UNSUPPORTED_FRAME)
    assert "frame 0 means nothing here" in said
    assert ask(placed, 0, x=490_000_000, y=110_000_000)[1] == ACCEPTED
    assert ask(placed, 0, x=580_000_000, y=110_000_000)[1:] == (
        DENIED,
        "Home: 1000 km away or farther",
    )
    assert ask(bench, 1, mode=Mode.RTL)[1:] == (BUSY, "Home: not while the robot drives there")
    bench.command(m.MAV_CMD_DO_SET_HOME, 0)
    bench.step(bench.control(), bench.navigation())
    (ack,) = bench.messages("COMMAND_ACK")
    assert ack.result == m.MAV_RESULT_COMMAND_INT_ONLY


def test_who_returns_the_way_it_came_has_its_home_where_it_is(placed):
    robot = TelemetryRobot("trail", plans=False)
    placed.telemetry = Telemetry(placed.config, robot, placed.links)
    latitude, longitude = (round(1e7 * each) for each in ORIGIN.from_world(12.0, 7.0))
    requests, result, said = ask(placed, 0, x=latitude, y=longitude)
    assert (requests, result) == ([], DENIED)
    assert "only here" in said
    assert ask(placed, 1)[1] == ACCEPTED


def test_all_are_told_when_home_has_moved(placed):
    placed.step(placed.control(), placed.navigation())
    assert placed.messages("HOME_POSITION") == []
    placed.step(placed.control(), placed.navigation(home=(4.0, 2.0, 0.0)))
    (home,) = placed.messages("HOME_POSITION")
    assert (home.x, home.y) == (2.0, 4.0)  # north, east
    placed.step(placed.control(), placed.navigation(home=(4.0, 2.0, 0.0)))
    assert placed.messages("HOME_POSITION") == []
