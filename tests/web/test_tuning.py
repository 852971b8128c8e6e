"""Parameters and the robot's file, as far as clients may ask for them."""

from __future__ import annotations

import time

import msgspec
import pytest

from robotctl.errors import ConfigError
from robotctl.messages.control import SafetyState
from robotctl.messages.tuning import (
    ParameterAnswer,
    ParameterFacts,
    ParameterTable,
    ParameterValues,
    ResetParameters,
    SetParameter,
)
from robotctl.web.access import Role
from robotctl.web.desk import Desk, Save
from robotctl.web.published import read
from robotctl.web.robot_view import Now
from robotctl.web.wire import (
    Refused,
    ResetRequest,
    ResponseRequest,
    SaveRequest,
    Sticks,
    TakeDriving,
    TuneRequest,
)
from tests.web.conftest import Served, control_state

MS = 1_000_000
NOW = Now(1_000_000 * MS, 5_000 * MS)
AT_MS = NOW.server_ns / 1e6


def facts(name, key, default, *, is_fixed=False):
    is_whole = not isinstance(default, float)
    return ParameterFacts(
        name, key, default, 0.0, 9.0, "V", "Gain [V].", "at once", is_fixed, is_whole
    )


TABLE = ParameterTable(
    1,
    (
        facts("KP", "control.left.kp", 0.5),
        facts("HOLD", "mavlink.hold_on_gcs_loss", default=False),
        facts("COUNTS", "drive.counts_per_revolution", 2400, is_fixed=True),
    ),
)
VALUES = ParameterValues(2, (1.0, True, 2400), (0.5, True, 2400))


def later(milliseconds: int) -> Now:
    return Now(NOW.server_ns + milliseconds * MS, NOW.robot_ns + milliseconds * MS)


def hear(desk, *messages, now=NOW):
    for each in messages:
        desk.hear(read(msgspec.msgpack.encode(each)), now)


def as_sent(message):
    return msgspec.msgpack.decode(msgspec.msgpack.encode(message))


@pytest.fixture
def desk() -> Desk:
    desk = Desk(has_localiser=False, arm_timeout_ns=1)
    for client in (1, 2):
        desk.join(client, f"connection {client}", may_drive=True)
        desk.name(client, f"client {client}")
    desk.join(3, "connection 3", may_drive=False)
    hear(desk, control_state(SafetyState.ARMED, stamp_ns=NOW.robot_ns))
    return desk


def refusals(desk: Desk) -> list[str]:
    return [each.message.reason for each in desk.take().answers if type(each.message) is Refused]


REQUESTS = [
    TuneRequest(7, AT_MS, "KP", 1.0),
    ResetRequest(7, AT_MS),
    SaveRequest(7, AT_MS),
    ResponseRequest(7, AT_MS),
]


def nothing_is_asked(out) -> bool:
    return not (out.to_telemetry or out.saves or out.to_control or out.to_navigation)


@pytest.mark.parametrize("request_", REQUESTS)
def test_who_may_look_only_tunes_nothing(desk, request_):
    hear(desk, TABLE, VALUES)
    desk.take_message(3, request_, NOW)
    out = desk.take()
    assert nothing_is_asked(out)
    assert [each.connection for each in out.answers] == ["connection 3"]
    assert "look only" in out.answers[0].message.reason


@pytest.mark.parametrize("request_", REQUESTS)
@pytest.mark.parametrize(("age_ms", "said"), [(1001, "late"), (-500, "ahead")])
def test_what_comes_late_tunes_nothing(desk, request_, age_ms, said):
    hear(desk, TABLE, VALUES)
    desk.take_message(1, request_, later(age_ms))
    out = desk.take()
    assert nothing_is_asked(out)
    assert said in out.answers[0].message.reason


@pytest.mark.parametrize("request_", REQUESTS)
def test_the_driver_tunes_while_driving_and_nobody_else(desk, request_):
    hear(desk, TABLE, VALUES)
    desk.take_message(1, TakeDriving(1, AT_MS), NOW)
    for sample, held in enumerate((False, True)):
        desk.take_message(1, Sticks(sample, AT_MS, held, 0.5, 0.0, 0.0), NOW)
    desk.take()
    desk.take_message(2, request_, NOW)
    assert refusals(desk) == ["client 1 drives: take over first"]
    desk.take_message(1, request_, NOW)
    assert refusals(desk) == []


def test_a_request_goes_to_telemetry_and_its_refusal_to_who_asked(desk):
    desk.take_message(1, TuneRequest(7, AT_MS, "KP", 100.0), NOW)
    desk.take_message(2, TuneRequest(8, AT_MS, "KP", None), NOW)
    desk.take_message(2, ResetRequest(9, AT_MS), NOW)
    first, second, third = desk.take().to_telemetry
    numbers = [each.request_id for each in (first, second, third)]
    assert first == SetParameter(NOW.robot_ns, numbers[0], "KP", 100.0)
    assert second == SetParameter(NOW.robot_ns, numbers[1], "KP", None)
    assert third == ResetParameters(NOW.robot_ns, numbers[2])
    assert len(set(numbers)) == 3
    hear(
        desk,
        ParameterAnswer(numbers[1], ""),
        ParameterAnswer(numbers[0], "KP: 100 found, 0 to 9 allowed"),
        ParameterAnswer(numbers[0], "again"),
        ParameterAnswer(12345, "of somebody else"),
    )
    (answer,) = desk.take().answers
    assert answer.connection == "connection 1"
    assert answer.message == Refused(7, "KP: 100 found, 0 to 9 allowed")
    desk.step(later(1600))
    (answer,) = desk.take().answers
    assert answer.connection == "connection 2"
    assert answer.message == Refused(9, "telemetry does not answer")


def test_an_answer_for_a_client_that_has_left_goes_to_nobody(desk):
    desk.take_message(1, TuneRequest(7, AT_MS, "KP", 100.0), NOW)
    (asked,) = desk.take().to_telemetry
    desk.leave(1, NOW)
    hear(desk, ParameterAnswer(asked.request_id, "no"))
    desk.step(later(5000))
    assert desk.take().answers == []


def test_all_wanted_values_but_those_of_the_file_alone_are_saved_by_their_keys(desk):
    desk.take_message(1, SaveRequest(7, AT_MS), NOW)
    assert "not told the parameters yet" in refusals(desk)[0]
    hear(desk, TABLE, VALUES)
    desk.take_message(1, SaveRequest(8, AT_MS), NOW)
    values = {"control.left.kp": 1.0, "mavlink.hold_on_gcs_loss": True}
    assert desk.take().saves == [Save("connection 1", 8, values)]


def test_a_response_has_the_states_of_the_last_five_seconds(desk):
    for number in range(400):
        state = control_state(stamp_ns=number)
        state = msgspec.structs.replace(
            state, wheel_ref_rad_s=(1.0, 2.0), wheel_rad_s=(number / 1.0, 0.0)
        )
        hear(desk, state)
    desk.take_message(1, ResponseRequest(7, AT_MS), NOW)
    (answer,) = desk.take().answers
    response = answer.message
    assert response.id == 7
    assert response.stamp_ns == tuple(range(150, 400))
    assert set(response.wheel_ref_rad_s) == {(1.0, 2.0)}
    assert response.wheel_rad_s[-1] == (399.0, 0.0)


# At the server


def test_a_client_is_told_the_table_and_the_values_once_unless_they_change(served):
    with served.client() as client:
        served.robot.publish(TABLE, VALUES)
        assert client.read("ParameterValues") == as_sent(VALUES)  # news, before the pictures
        assert client.read("ParameterTable") == as_sent(TABLE)
        served.robot.publish(msgspec.structs.replace(VALUES, stamp_ns=3))
        for _ in range(4):  # pictures that follow it
            client.read("ControlState")
        changed = msgspec.structs.replace(VALUES, stamp_ns=4, wanted=(0.7, True, 2400))
        served.robot.publish(changed)
        client.read("ParameterValues")
        stamps = [each["stamp_ns"] for each in client.seen if each["type"] == "ParameterValues"]
        assert stamps == [2, 4]
    with served.client() as client:
        assert client.read("ParameterValues") == as_sent(changed)


def test_what_telemetry_refuses_reaches_its_client_alone(served):
    with served.client() as client, served.client() as other:
        client.synchronise()
        client.send("TuneRequest", id=5, at_ms=client.at_ms(), name="KP", value=100)
        while not served.robot.telemetry:
            time.sleep(0.005)
        (asked,) = served.robot.telemetry
        assert (asked.name, asked.value) == ("KP", 100.0)
        served.robot.publish(ParameterAnswer(asked.request_id, "no"), VALUES)
        assert client.read("Refused") == {"type": "Refused", "id": 5, "reason": "no"}
        other.read("ParameterValues")
        assert {each["type"] for each in other.seen} & {"Refused", "ParameterAnswer"} == set()


def test_a_file_is_saved_and_what_speaks_against_it_is_said(served):
    served.robot.publish(TABLE, VALUES)
    with served.client() as client:
        client.read("ParameterValues")
        client.synchronise()
        client.send("SaveRequest", id=5, at_ms=client.at_ms())
        saved = client.read("Saved")
        assert (saved["id"], saved["file"], saved["copy"]) == (5, "robby.toml", "robby.toml.~1~")
        for error in (ConfigError("has changed since"), PermissionError(13, "Permission denied")):
            served.robot.why_not_saved = error
            client.send("SaveRequest", id=6, at_ms=client.at_ms())
            assert str(error) in client.read("Refused")["reason"]
    assert len(served.robot.saved) == 1


def test_a_disk_that_hangs_delays_no_stop(served, monkeypatch):
    served.robot.publish(TABLE, VALUES)
    with served.client() as client, served.client("/stop") as stop:
        client.read("ParameterValues")
        client.synchronise()
        monkeypatch.setattr(served.page._robot, "save", lambda _values: time.sleep(1.0))
        client.send("SaveRequest", id=5, at_ms=client.at_ms())
        client.send("SaveRequest", id=6, at_ms=client.at_ms())
        answer = client.read("Refused")
        assert (answer["id"], answer["reason"]) == (6, "the file is being written")
        began_s = time.monotonic()
        stop.send("Ping", t=1.0)
        stop.read("Pong")
        stop.send("Stop", id=1)
        while not served.robot.control:
            time.sleep(0.001)
        assert time.monotonic() - began_s < 0.5


@pytest.mark.parametrize(
    "fields",
    [
        {"name": "K" * 17, "value": 1},
        {"name": 5, "value": 1},
        {"name": "KP", "value": "1"},
        {"name": "KP", "value": True},
        {"name": "KP"},
        {"name": "KP", "value": 1, "key": "control.left.kp"},
    ],
)
def test_what_is_no_request_ends_its_connection(served, fields):
    with served.client() as client:
        client.synchronise()
        client.send("TuneRequest", id=5, at_ms=client.at_ms(), **fields)
        assert "no such message" in client.ended().rcvd.reason
    assert served.robot.telemetry == []


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "1" * 400])
def test_numbers_that_are_none_never_get_to_telemetry(served, number):
    with served.client() as client:
        client.synchronise()
        start = f'{{"type": "TuneRequest", "id": 1, "at_ms": {client.at_ms()}, "name": "KP", '
        client.ws.send(f'{start}"value": {number}}}')
        assert "no such message" in client.ended().rcvd.reason
    assert served.robot.telemetry == []


def test_who_may_look_is_shown_the_parameters_and_refused(static):
    with Served(static, {Role.DRIVE: "d" * 43, Role.LOOK: "l" * 43}) as served:
        cookie = f"{served.access.cookie}={served.access.exchange('l' * 43)[1]}"
        served.robot.publish(TABLE, VALUES)
        with served.client(cookie=cookie) as client:
            client.read("ParameterValues")
            client.synchronise()
            client.send("TuneRequest", id=5, at_ms=client.at_ms(), name="KP", value=1)
            assert "look only" in client.read("Refused")["reason"]
        assert served.robot.telemetry == []
