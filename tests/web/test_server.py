"""The server by foreign clients: what each of them is let do, and what bad company costs."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import socket
import ssl
import threading
import time

import httpx
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus

from robotctl.messages.control import (
    Ack,
    Arm,
    EmergencyStop,
    ManualControl,
    Mode,
    Notice,
    PositionTarget,
    SafetyState,
    SetMode,
)
from robotctl.messages.estimation import GivenMap, LidarScan, LiveMap
from robotctl.messages.faults import Fault, FaultCode
from robotctl.web.access import Role
from robotctl.web.secret_files import certificate_of, fingerprint_of, tokens_of
from robotctl.web.server import MAX_CLIENTS, MESSAGES_AT_ONCE, MESSAGES_PER_S
from robotctl.web.wire import ComputerState
from tests.web.conftest import Served, control_state, navigation_state

TOKENS = {Role.LOOK: "look" * 11, Role.DRIVE: "drive" * 9}


def wait(condition, seconds=5.0, what=""):
    deadline_s = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline_s, what or "did not happen in time"
        time.sleep(0.002)
    return result


def of(requests, kind):
    return [each for each in requests if isinstance(each, kind)]


def get(served, path="/", **headers):
    return httpx.get(f"{served.url}{path}", headers=headers, verify=False, trust_env=False)


def refused(served, path="/live", **options) -> str:
    with pytest.raises(InvalidStatus) as error:
        served.client(path, **options)
    assert error.value.response.status_code == 403
    return error.value.response.body.decode()


def drive(client, seconds, sample=0, held=True, **axes):
    """Hold the sticks at 20 Hz; return the next sample number."""
    end_s = time.monotonic() + seconds
    axes = {"forward": 0.5, "turn": 0.0, "sideways": 0.0, **axes}
    while time.monotonic() < end_s:
        client.send("Sticks", sample=sample, at_ms=client.at_ms(), held=held, **axes)
        sample += 1
        time.sleep(0.05)
    return sample


def take_over(client) -> None:
    client.synchronise()
    client.send("TakeDriving", id=1, at_ms=client.at_ms())
    client.read("Driver", where=lambda message: message["client"] is not None)


# Pages


def test_the_page_and_its_parts_are_served_with_strict_headers(served):
    answer = get(served)
    assert answer.status_code == 200
    assert "<title>page</title>" in answer.text
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert not any(name.startswith("access-control") for name in answer.headers)
    script = get(served, "/assets/page.js")
    assert script.headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize(
    "path", ["/assets/../secret.js", "/assets/%2e%2e%2fsecret.js", "/assets/..%2Fsecret.js",
             "/assets/index.py", "/assets//etc/passwd", "/assets/%00", "/nothing"],
)  # fmt: skip
def test_nothing_outside_the_folder_of_the_page_is_served(served, path):
    with socket.create_connection(("127.0.0.1", served.port)) as raw:
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n\r\n".encode())
        head = raw.recv(4096)
    assert b" 404 " in head.split(b"\r\n")[0]
    assert b"secret" not in head.split(b"\r\n\r\n")[1]


# Who is let in


def test_a_foreign_page_gets_no_socket(served):
    for path in ("/live", "/stop"):
        assert "another page" in refused(served, path, origin="https://evil.example")
        assert "missing" in refused(served, path, origin="")
    assert served.robot.control == []


def test_a_name_that_was_rebound_to_this_computer_is_refused(served):
    host = f"evil.example:{served.port}"
    assert get(served, Host=host).status_code == 403
    raw = socket.create_connection(("127.0.0.1", served.port))
    with raw:
        raw.sendall(
            f"GET /live HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        assert b" 403 " in raw.recv(4096).split(b"\r\n")[0]


@pytest.fixture
def guarded(static):
    with Served(static, TOKENS) as served:
        yield served


def cookie_of(served, role) -> str:
    answer = httpx.post(
        f"{served.url}/session",
        content=json.dumps({"token": TOKENS[role]}),
        headers={"Origin": served.url},
        trust_env=False,
    )
    assert (answer.status_code, answer.text) == (200, role)
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    return cookie.partition(";")[0]


def test_without_a_token_there_are_no_sockets(guarded):
    assert get(guarded).status_code == 200, "the page itself says nothing of the robot"
    assert get(guarded, "/session").status_code == 403
    for path in ("/live", "/stop"):
        assert "token" in refused(guarded, path)
        assert "token" in refused(guarded, path, cookie=f"{guarded.access.cookie}={'0' * 64}")


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"token": "x"}', 403),
        (b"{}", 400),
        (b"\xff", 400),
        (b"[" * 4000, 400),
        (b"x" * 5000, 413),
    ],
)
def test_a_wrong_token_is_refused(guarded, body, status):
    answer = httpx.post(
        f"{guarded.url}/session", content=body, headers={"Origin": guarded.url}, trust_env=False
    )
    assert answer.status_code == status
    assert "set-cookie" not in answer.headers


def test_a_foreign_page_cannot_post_a_token(guarded):
    body = json.dumps({"token": TOKENS[Role.DRIVE]})
    for headers in ({"Origin": "https://evil.example"}, {}):
        answer = httpx.post(
            f"{guarded.url}/session", content=body, headers=headers, trust_env=False
        )
        assert answer.status_code == 403
        assert "set-cookie" not in answer.headers


def test_who_may_look_sees_all_and_may_only_stop(guarded):
    cookie = cookie_of(guarded, Role.LOOK)
    assert get(guarded, "/session", Cookie=cookie).text == "look"
    with guarded.client(cookie=cookie) as client:
        assert client.read("Hello")["role"] == "look"
        client.synchronise()
        at_ms = client.at_ms()
        for number, (kind, fields) in enumerate(
            [
                ("ArmRequest", {"arm": True}),
                ("ArmRequest", {"arm": False}),
                ("ModeRequest", {"mode": 4}),
                ("GoTo", {"x_m": 1.0, "y_m": 1.0, "heading_rad": None}),
                ("PlaceRobot", {"x_m": 1.0, "y_m": 1.0, "theta_rad": 0.0}),
                ("TakeDriving", {}),
            ]
        ):
            client.send(kind, id=number, at_ms=at_ms, **fields)
            answer = client.read("Refused")
            assert answer["id"] == number
            assert "look only" in answer["reason"]
        drive(client, 0.2)
        assert (guarded.robot.control, guarded.robot.navigation) == ([], [])
        client.send("StopRequest", id=9)
        wait(lambda: of(guarded.robot.control, EmergencyStop))


def test_no_log_tells_a_token_or_a_cookie(guarded, caplog):
    caplog.set_level("DEBUG")
    cookie = cookie_of(guarded, Role.DRIVE)
    with guarded.client(cookie=cookie) as client:
        client.read("Hello")
    refused(guarded, cookie=cookie + "0")
    told = [each.getMessage() for each in caplog.records if each.name.startswith("uvicorn")]
    for secret in (*TOKENS.values(), cookie.partition("=")[2]):
        assert not any(secret in each for each in told)


def test_tokens_are_kept_for_their_user_alone_and_made_once(tmp_path):
    tokens = tokens_of(tmp_path)
    assert tokens_of(tmp_path) == tokens
    assert len(set(tokens.values())) == len(Role)
    (file,) = tmp_path.iterdir()
    assert file.stat().st_mode & 0o777 == 0o600
    file.chmod(0o644)
    with pytest.raises(Exception, match="open to others"):
        tokens_of(tmp_path)


def test_the_page_is_served_by_tls_with_the_certificate_whose_fingerprint_is_told(static, tmp_path):
    certificate = certificate_of(tmp_path, ["127.0.0.1", "localhost"])
    assert certificate.stat().st_mode & 0o777 == 0o600
    context = ssl.create_default_context(cafile=certificate)
    with Served(static, certificate=certificate) as served:
        der = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate(("127.0.0.1", served.port)))
        answer = httpx.get(served.url, verify=context, trust_env=False)
        assert answer.status_code == 200
        with served.client(ssl=context) as client:
            assert client.read("Hello")["name"] == "robby"
    told = fingerprint_of(certificate).replace(":", "").lower()
    assert told == hashlib.sha256(der).hexdigest()


# What is sent


def test_a_client_gets_hello_first_then_what_is_known_then_the_messages_unchanged(served):
    scan = LidarScan(1, 0.0, 0.0, 0.0, 0.1, 8.0, b"\x00\x00\x80\x3f" * 3)
    served.robot.publish(Notice(1, 6, "before"), scan)
    time.sleep(0.1)
    with served.client() as client:
        client.read("Driver")
        first = client.seen[0]
        assert (first["type"], first["protocol"], first["role"]) == ("Hello", 2, "drive")
        assert client.seen[1]["client"] is None
        assert client.read("Notice")["text"] == "before"
        assert client.read("LidarScan") == {**msgspec.to_builtins(scan), "ranges": scan.ranges}
        served.robot.publish(Notice(2, 6, "after"))
        assert client.read("Notice")["text"] == "after"


def test_every_notice_arrives_and_pictures_at_20_a_second(served):
    scan = LidarScan(1, 0.0, 0.0, 0.0, 0.1, 8.0, b"")
    with served.client() as client:
        client.read("Driver")
        begin_s = time.monotonic()
        for number in range(100):
            served.robot.publish(Notice(number, 6, f"n{number}"), *[scan] * 3)
            time.sleep(0.01)
        client.read("Notice", where=lambda message: message["text"] == "n99")
        took_s = time.monotonic() - begin_s
    texts = [each["text"] for each in client.seen if each["type"] == "Notice"]
    assert texts == [f"n{number}" for number in range(100)]
    scans = sum(each["type"] == "LidarScan" for each in client.seen)
    assert scans <= 20 * took_s + 2


def test_a_change_of_state_reaches_a_client_though_the_next_state_follows_at_once(served):
    with served.client() as client:
        client.read("ControlState")
        for _ in range(20):
            fault = control_state(SafetyState.FAULT, "something")
            served.robot.publish(fault, control_state(SafetyState.ARMED))
            client.read("ControlState", where=lambda message: message["state"] == SafetyState.FAULT)


def test_a_message_that_counts_down_is_a_picture_and_a_new_one_is_news(served):
    with served.client() as client:
        client.read("Driver")
        begin_s = time.monotonic()
        for number in range(100):
            served.robot.publish(navigation_state(Mode.AUTO, f"{number / 10} m to go"))
            time.sleep(0.01)
        served.robot.publish(navigation_state(Mode.AUTO, "waits: somebody is in the way"))
        served.robot.publish(navigation_state(Mode.AUTO, "0.1 m to go"))
        client.read("NavigationState", where=lambda message: "waits" in message["message"])
        took_s = time.monotonic() - begin_s
    count = sum(each["type"] == "NavigationState" for each in client.seen)
    assert count <= 20 * took_s + 3


def test_a_map_of_many_megabytes_cuts_nobody_off(served):
    cells = bytes(4000 * 4000)
    served.robot.publish(GivenMap(1, LiveMap(1, 4000, 4000, 0.05, 0.0, 0.0, cells)))
    time.sleep(0.1)
    with served.client(max_size=None) as client:
        assert client.read("GivenMap", 20.0)["map"]["cells"] == cells
        client.synchronise()


def test_a_client_that_does_not_read_costs_only_itself(served):
    big = LidarScan(1, 0.0, 0.0, 0.0, 0.1, 8.0, bytes(30_000))
    slow = socket.create_connection(("127.0.0.1", served.port))
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    with slow, served.client() as quick:
        host = f"127.0.0.1:{served.port}"
        slow.sendall(
            f"GET /live HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        wait(lambda: len(served.page._live) == 2)
        for number in range(400):
            served.robot.publish(big, Notice(number, 6, f"n{number}" + "x" * 5000))
            begin_s = time.monotonic()
            quick.read("Notice", where=lambda m, n=number: m["text"].startswith(f"n{n}x"))
            assert time.monotonic() - begin_s < 1.0
        wait(lambda: len(served.page._live) == 1, 2.0, "the slow client was not cut off")


# What is asked


def test_arming_is_asked_of_control_and_its_reasons_come_back(served):
    served.robot.state = SafetyState.STANDBY
    with served.client() as client:
        client.synchronise()
        client.send("ArmRequest", id=5, at_ms=client.at_ms(), arm=True)
        (arm,) = wait(lambda: of(served.robot.control, Arm))
        assert arm.arm
        reason = Fault(FaultCode.BUS_OFF, "the bus is off")
        ack = Ack(arm.request_id, accepted=False, reasons=(reason,))
        served.robot.publish(control_state(SafetyState.STANDBY, acks=(ack,)))
        answer = client.read("Refused")
        assert answer["id"] == 5
        assert str(reason) in answer["reason"]


def test_a_click_of_long_ago_moves_nothing_but_hold_and_disarm_always_count(served):
    with served.client() as client:
        client.synchronise()
        old_ms = client.at_ms() - 1500.0
        client.send("ModeRequest", id=1, at_ms=old_ms, mode=10)
        assert "late" in client.read("Refused")["reason"]
        client.send("GoTo", id=2, at_ms=old_ms, x_m=1.0, y_m=1.0, heading_rad=None)
        assert "late" in client.read("Refused")["reason"]
        client.send("ArmRequest", id=3, at_ms=old_ms, arm=True)
        assert "late" in client.read("Refused")["reason"]
        client.send("ModeRequest", id=4, at_ms=client.at_ms() + 1000.0, mode=10)
        assert "ahead" in client.read("Refused")["reason"]
        client.send("ModeRequest", id=5, at_ms=old_ms, mode=4)
        client.send("ArmRequest", id=6, at_ms=old_ms, arm=False)
        wait(lambda: of(served.robot.control, Arm))
    assert [each.mode for each in of(served.robot.navigation, SetMode)] == [Mode.HOLD]
    assert [each.arm for each in of(served.robot.control, Arm)] == [False]


def test_go_to_asks_for_guided_and_the_place_of_an_armed_robot_only(served):
    with served.client() as client:
        client.synchronise()
        client.read("ControlState")
        client.send("GoTo", id=1, at_ms=client.at_ms(), x_m=1.0, y_m=2.0, heading_rad=None)
        (target,) = wait(lambda: of(served.robot.navigation, PositionTarget))
        assert (target.x_m, target.y_m, target.heading_rad) == (1.0, 2.0, None)
        assert of(served.robot.navigation, SetMode)[0].mode is Mode.GUIDED
        served.robot.state = SafetyState.STANDBY
        client.read("ControlState", where=lambda message: message["state"] == SafetyState.STANDBY)
        client.send("GoTo", id=2, at_ms=client.at_ms(), x_m=1.0, y_m=2.0, heading_rad=None)
        assert "arm first" in client.read("Refused", where=lambda m: m["id"] == 2)["reason"]


def test_a_mode_that_navigation_does_not_take_is_refused_in_its_words(served):
    served.robot.publish(navigation_state(Mode.HOLD, "no mission"))
    with served.client() as client:
        client.synchronise()
        client.send("ModeRequest", id=3, at_ms=client.at_ms(), mode=10)
        answer = client.read("Refused")
        assert answer["id"] == 3
        assert "no mission" in answer["reason"]


def test_the_robot_follows_the_sticks_of_its_driver_alone(served):
    with served.client() as one, served.client() as two:
        take_over(one)
        sample = drive(one, 0.1, held=False)
        drive(one, 0.3, sample, turn=-0.25)
        sticks = of(served.robot.navigation, ManualControl)
        assert served.robot.navigation[0].mode is Mode.MANUAL
        assert {(each.forward, each.turn) for each in sticks} == {(0.5, -0.25)}
        assert all(each.expires_ns - each.stamp_ns <= 300_000_000 for each in sticks)
        two.synchronise()
        two.send("GoTo", id=4, at_ms=two.at_ms(), x_m=1.0, y_m=1.0, heading_rad=None)
        assert "drives" in two.read("Refused")["reason"]
        served.robot.navigation.clear()
        drive(two, 0.2, forward=-1.0)
        assert not [each for each in of(served.robot.navigation, ManualControl) if each.forward < 0]
        two.send("TakeDriving", id=5, at_ms=two.at_ms())
        asked = one.read("Driver", where=lambda message: message["asking"] is not None)
        one.send("GiveDriving")
        assert two.read("Driver", where=lambda m: m["client"] == asked["asking"])
        assert served.robot.navigation[-1].forward == 0.0


def test_sticks_that_were_recorded_and_are_sent_again_do_nothing(served):
    with served.client() as client:
        take_over(client)
        lines = []
        for sample, held in enumerate([False] * 3 + [True] * 5):
            line = {"type": "Sticks", "sample": sample, "at_ms": client.at_ms(), "held": held,
                    "forward": 1.0, "turn": 0.0, "sideways": 0.0}  # fmt: skip
            lines.append(json.dumps(line))
            client.ws.send(lines[-1])
            time.sleep(0.02)
        client.send("GiveDriving")
    wait(lambda: len(served.page._live) == 0)
    served.robot.navigation.clear()
    with served.client() as client:
        take_over(client)
        time.sleep(0.3)
        for line in lines * 3:
            client.ws.send(line)
        client.synchronise()
    moved = [each for each in of(served.robot.navigation, ManualControl) if each.forward]
    assert moved == []


def test_a_driver_whose_connection_is_cut_is_at_rest_at_once(served):
    client = served.client()
    take_over(client)
    drive(client, 0.3, drive(client, 0.1, held=False))
    client.ws.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    begin_s = time.monotonic()
    client.ws.socket.close()
    wait(lambda: served.robot.navigation[-1].forward == 0.0)
    assert time.monotonic() - begin_s < 0.4


def test_a_driver_that_falls_silent_is_at_rest_in_200_ms(served):
    with served.client() as client:
        take_over(client)
        drive(client, 0.3, drive(client, 0.1, held=False))
        begin_s = time.monotonic()
        wait(lambda: served.robot.navigation[-1].forward == 0.0)
        assert time.monotonic() - begin_s < 0.3
        told = client.read("Driver", where=lambda message: message["locked"])
        assert "stood still" in told["locked"]


def test_a_robot_that_loses_power_needs_a_fresh_edge(served):
    with served.client() as client:
        take_over(client)
        sample = drive(client, 0.3, drive(client, 0.1, held=False))
        served.robot.state = SafetyState.STANDBY
        sample = drive(client, 0.3, sample)
        served.robot.state = SafetyState.ARMED
        time.sleep(0.05)
        served.robot.navigation.clear()
        sample = drive(client, 0.3, sample)
        assert of(served.robot.navigation, ManualControl) == []
        drive(client, 0.2, drive(client, 0.1, sample, held=False))
        assert of(served.robot.navigation, ManualControl)


def test_another_mode_takes_the_sticks_away(served):
    with served.client() as client:
        take_over(client)
        sample = drive(client, 0.2, drive(client, 0.1, held=False))
        served.robot.publish(navigation_state(Mode.MANUAL))
        sample = drive(client, 0.2, sample)
        served.robot.publish(navigation_state(Mode.HOLD))
        drive(client, 0.2, sample)
        assert served.robot.navigation[-1].forward == 0.0
        told = client.read("Driver", where=lambda message: message["locked"])
        assert "HOLD" in told["locked"]


# Stops


def test_a_stop_is_sent_and_answered_with_what_control_says(served):
    with served.client("/stop") as client:
        client.send("Ping", t=1.0)
        assert client.read("Pong")["t"] == 1.0
        client.send("Stop", id=3)
        wait(lambda: of(served.robot.control, EmergencyStop))
        served.robot.publish(control_state(SafetyState.EMERGENCY_STOP, "operator"))
        answer = client.read("StopSeen")
        assert (answer["id"], answer["state"]) == (3, SafetyState.EMERGENCY_STOP)
        assert answer["reason"] == "operator"
        assert 0.0 < answer["after_ms"] < 500.0
        time.sleep(0.7)
        assert len(of(served.robot.control, EmergencyStop)) == 1


def test_a_stop_that_is_not_answered_is_repeated_and_that_is_said(served):
    served.robot.is_silent = True
    with served.client("/stop") as client:
        client.send("Stop", id=3)
        answer = client.read("StopSeen")
        assert answer["state"] is None
        assert 450.0 < answer["after_ms"] < 900.0
    sent = len(of(served.robot.control, EmergencyStop))
    wait(lambda: len(of(served.robot.control, EmergencyStop)) > sent, what="not repeated")
    served.robot.publish(control_state(SafetyState.EMERGENCY_STOP, "operator"))
    wait(lambda: served.robot.published == [])
    time.sleep(0.1)
    sent = len(of(served.robot.control, EmergencyStop))
    time.sleep(0.7)
    assert len(of(served.robot.control, EmergencyStop)) == sent


def test_an_older_state_of_emergency_is_no_answer(served):
    served.robot.is_silent = True
    with served.client("/stop") as client:
        before_ns = time.monotonic_ns()
        client.send("Stop", id=3)
        wait(lambda: of(served.robot.control, EmergencyStop))
        served.robot.publish(control_state(SafetyState.FAULT, "old", stamp_ns=before_ns - 1))
        assert client.read("StopSeen")["state"] is None


# Bad company


STICKS = '{"type": "Sticks", "sample": 1, "at_ms": 0, "held": true, "turn": 0, "sideways": 0, '
BAD = [
    *("", "x", "{}", "[]", "null", "[" * 3000, '{"type": ' * 400),
    *('{"type": "Nothing"}', '{"type": "Ping"}', '{"type": "Ping", "t": "1"}'),
    *('{"type": "Ping", "t": 1, "u": 2}', '{"type": "Ping", "t": 1e999}'),
    *('{"type": "Ping", "t": NaN}', STICKS + '"forward": 1.1}', STICKS + '"forward": null}'),
    '{"type": "ModeRequest", "id": 1, "at_ms": 0, "mode": 1}',
    '{"type": "StopRequest", "id": 1' + "0" * 400 + "}",
]


@pytest.mark.parametrize("text", BAD)
def test_what_is_no_message_ends_its_connection_with_words(served, text):
    with served.client() as client:
        client.ws.send(text)
        closed = client.ended()
        assert closed.rcvd.code == 1008
        assert "no such message" in closed.rcvd.reason
    with served.client() as client:
        assert client.read("Hello")
    assert (served.robot.control, served.robot.navigation) == ([], [])


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_garbage_asks_nothing_of_the_robot(served, data):
    with served.client() as client:
        client.ws.send(data)
        with contextlib.suppress(ConnectionClosed, TimeoutError):
            while True:
                client.ws.recv(timeout=0.05)
    assert served.robot.control == []


def test_bytes_that_are_no_frame_end_their_connection(served):
    with served.client() as bad, served.client() as good:
        bad.ws.socket.sendall(os.urandom(2000))
        bad.ended()
        good.synchronise()


def test_a_message_that_is_too_long_ends_its_connection(served):
    with served.client() as client:
        client.ws.send("x" * 5000)
        closed = client.ended()
        assert closed.rcvd.code == 1009


def test_a_disk_that_hangs_holds_up_no_stop(served):
    asked, goes_on = threading.Event(), threading.Event()

    def hang():
        asked.set()
        goes_on.wait(20.0)
        return ComputerState(0.75, None, 1, 2, None)

    served.robot.computer = hang
    try:
        with served.client() as client, served.client("/stop") as stopping:
            assert asked.wait(5.0)
            begin_s = time.monotonic()
            stopping.send("Stop", id=1)
            wait(lambda: of(served.robot.control, EmergencyStop))
            assert time.monotonic() - begin_s < 0.2
            goes_on.set()
            assert client.read("ComputerState")["processor"] == 0.75
    finally:
        goes_on.set()


def test_a_flooding_client_is_cut_off_and_a_stop_beside_it_is_quick(served):
    with served.client() as flooding, served.client("/stop") as stopping:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(20 * MESSAGES_PER_S):
                flooding.send("Ping", t=1.0)
        begin_s = time.monotonic()
        stopping.send("Stop", id=1)
        wait(lambda: of(served.robot.control, EmergencyStop))
        assert time.monotonic() - begin_s < 0.2
        closed = flooding.ended()
        assert closed.rcvd is None or "too fast" in closed.rcvd.reason


def test_at_most_16_clients_are_connected(served):
    with contextlib.ExitStack() as stack:
        for _ in range(MAX_CLIENTS):
            stack.enter_context(served.client()).read("Hello")
        more = stack.enter_context(served.client())
        assert more.ended().rcvd.code == 1008
        with served.client("/stop") as stopping:
            stopping.send("Ping", t=1.0)
            stopping.read("Pong")


@pytest.mark.parametrize("path", ["/live", "/stop"])
def test_those_who_may_only_look_keep_nobody_from_driving_or_the_stop(guarded, path):
    look, own = (cookie_of(guarded, role) for role in (Role.LOOK, Role.DRIVE))
    with contextlib.ExitStack() as stack:
        for _ in range(MAX_CLIENTS):
            looking = stack.enter_context(guarded.client(path, cookie=look))
            looking.send("Ping", t=1.0)
            looking.read("Pong")
        assert stack.enter_context(guarded.client(path, cookie=look)).ended().rcvd.code == 1008
        driver = stack.enter_context(guarded.client(path, cookie=own))
        driver.send("Ping", t=2.0)
        assert driver.read("Pong")["t"] == 2.0


def test_connections_that_ask_for_nothing_are_closed_or_never_taken(served):
    with contextlib.ExitStack() as stack:
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", served.port)))
            for _ in range(60)
        ]
        idle[-1].settimeout(5.0)
        with contextlib.suppress(ConnectionResetError):
            assert idle[-1].recv(1) == b"", "the last one was kept"
        idle[0].settimeout(8.0)
        assert idle[0].recv(1) == b"", "the first one was kept though it asked for nothing"
    with served.client() as client:
        client.read("Hello")


def test_a_page_that_sends_more_than_a_page_does_is_told_that_it_is_too_fast(served):
    with served.client() as client:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(2 * MESSAGES_AT_ONCE):
                client.send("Ping", t=1.0)
        assert "too fast" in client.ended().rcvd.reason


def test_a_client_that_floods_with_what_the_application_never_sees_is_dropped(served):
    with served.client() as flooding, served.client("/stop") as stopping:
        with contextlib.suppress(ConnectionClosed, OSError):
            for _ in range(20_000):
                flooding.ws.ping(ack_on_close=False)
        flooding.ended()
        stopping.send("Ping", t=1.0)
        stopping.read("Pong")


def test_an_address_that_connects_again_and_again_is_slowed_down_and_not_locked_out(served):
    page = httpx.Client(trust_env=False, headers={"Connection": "close"})
    dropped = 0
    for _ in range(150):
        try:
            page.get(served.url)
        except httpx.TransportError:
            dropped += 1
    assert dropped > 50
    time.sleep(0.6)
    assert get(served).status_code == 200


def test_a_part_of_the_page_that_is_known_is_not_sent_again(served):
    tag = get(served, "/assets/page.js").headers["etag"]
    again = get(served, "/assets/page.js", **{"If-None-Match": tag})
    assert (again.status_code, again.content) == (304, b"")
