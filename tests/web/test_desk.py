"""What clients may ask for, and in which order the robot is asked."""

from __future__ import annotations

import msgspec
import pytest

from robotctl.messages.control import (
    Arm,
    EmergencyStop,
    ExternalPose,
    ManualControl,
    Mode,
    SafetyState,
    SetMode,
)
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.web.desk import Desk
from robotctl.web.published import ControlState, LocalisationState
from robotctl.web.robot_view import Now
from robotctl.web.wire import (
    ArmRequest,
    GoTo,
    ModeRequest,
    PlaceRobot,
    Refused,
    Sticks,
    StopRequest,
    TakeDriving,
)

MS = 1_000_000
NOW = Now(1_000_000 * MS, 5_000 * MS)
AT_MS = NOW.server_ns / 1e6


def later(milliseconds: int) -> Now:
    return Now(NOW.server_ns + milliseconds * MS, NOW.robot_ns + milliseconds * MS)


def state(safety: SafetyState, now: Now = NOW) -> ControlState:
    return ControlState(now.robot_ns, safety, "")


@pytest.fixture
def desk() -> Desk:
    desk = Desk(has_localiser=True, arm_timeout_ns=3000 * MS)
    for client in (1, 2):
        desk.join(client, f"connection {client}", may_drive=True)
        desk.name(client, f"client {client}")
    desk.hear(state(SafetyState.ARMED), NOW)
    desk.hear(LocalisationState(LocalisationStatus.LOCALISED), NOW)
    return desk


def refusals(desk: Desk) -> list[str]:
    return [each.message.reason for each in desk.take().answers if type(each.message) is Refused]


def held_by_the_first(desk: Desk) -> None:
    desk.take_message(1, TakeDriving(1, AT_MS), NOW)
    for sample, held in enumerate((False, True)):
        desk.take_message(1, Sticks(sample, AT_MS, held, 0.5, 0.0, 0.0), NOW)


def test_manual_is_asked_for_before_the_first_stick(desk):
    held_by_the_first(desk)
    mode, sticks = desk.take().to_navigation
    assert mode == SetMode(NOW.robot_ns, Mode.MANUAL)
    assert sticks == ManualControl(NOW.robot_ns, NOW.robot_ns + 300 * MS, 0.5, 0.0, 0.0)


MOVING = [
    ArmRequest(7, AT_MS, True),
    ModeRequest(7, AT_MS, Mode.AUTO),
    GoTo(7, AT_MS, 1.0, 2.0, None),
    PlaceRobot(7, AT_MS, 1.0, 2.0, 0.0),
]


@pytest.mark.parametrize("request_", MOVING)
@pytest.mark.parametrize("client", [1, 2])
def test_nobody_moves_a_robot_by_click_while_somebody_drives_it(desk, request_, client):
    held_by_the_first(desk)
    desk.take()
    desk.take_message(client, request_, NOW)
    out = desk.take()
    assert (out.to_control, out.to_navigation) == ([], [])
    (answer,) = out.answers
    assert answer.connection == f"connection {client}"
    assert answer.message.id == 7


@pytest.mark.parametrize("request_", [ArmRequest(7, 0.0, False), ModeRequest(7, 0.0, Mode.HOLD)])
def test_everybody_who_may_drive_lets_it_stand_though_another_drives_it(desk, request_):
    held_by_the_first(desk)
    desk.take()
    desk.take_message(2, request_, NOW)
    out = desk.take()
    assert [*out.to_control, *out.to_navigation]
    assert out.answers == []


def test_a_stop_goes_before_all_that_was_asked_in_the_same_round(desk):
    desk.take_message(1, ArmRequest(1, AT_MS, True), NOW)
    desk.take_message(2, StopRequest(2), NOW)
    first, second = desk.take().to_control
    assert isinstance(first, EmergencyStop)
    assert isinstance(second, Arm)


def test_a_place_that_somebody_points_at_is_told_to_the_localiser_with_its_doubt(desk):
    desk.take_message(1, PlaceRobot(1, AT_MS, 1.0, 2.0, 0.5), NOW)
    (pose,) = desk.take().to_navigation
    assert isinstance(pose, ExternalPose)
    assert (pose.x_m, pose.y_m, pose.theta_rad) == (1.0, 2.0, 0.5)
    assert len(pose.covariance) == 6


def test_a_robot_is_not_armed_before_its_localiser_speaks_nor_placed_without_one():
    desk = Desk(has_localiser=True, arm_timeout_ns=MS)
    desk.join(1, "one", may_drive=True)
    desk.take_message(1, ArmRequest(1, AT_MS, True), NOW)
    assert refusals(desk) == ["the localiser is not ready"]
    desk = Desk(has_localiser=False, arm_timeout_ns=MS)
    desk.join(1, "one", may_drive=True)
    desk.take_message(1, PlaceRobot(1, AT_MS, 1.0, 2.0, 0.5), NOW)
    assert "no localiser" in refusals(desk)[0]


def test_control_that_does_not_answer_arming_is_said_after_its_time(desk):
    desk.take_message(1, ArmRequest(1, AT_MS, True), NOW)
    desk.step(later(2999))
    assert refusals(desk) == []
    desk.step(later(3001))
    assert refusals(desk) == ["control does not answer"]


def test_a_control_process_that_falls_silent_takes_the_sticks_away(desk):
    held_by_the_first(desk)
    desk.take()
    for milliseconds in range(50, 700, 50):
        now = later(milliseconds)
        sticks = Sticks(1 + milliseconds, now.server_ns / 1e6, True, 0.5, 0.0, 0.0)
        desk.take_message(1, sticks, now)
        desk.step(now)
    assert desk.take().to_navigation[-1].forward == 0.0
    assert "silent" in desk.driver.locked


def test_all_that_is_told_can_be_sent(desk):
    held_by_the_first(desk)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(desk.driver))["type"] == "Driver"
