"""The server by foreign clients: the page, and what each of them is told."""

from __future__ import annotations

import hashlib
import json
import socket
import ssl
import time

import httpx
import msgspec
import pytest

from robotctl.messages.control import (
    EmergencyStop,
    Mode,
    Notice,
    SafetyState,
)
from robotctl.messages.estimation import GivenMap, LidarScan, LiveMap
from robotctl.web.access import Role
from robotctl.web.secret_files import certificate_of, fingerprint_of
from tests.web.clients import TOKENS, cookie_of, drive, get, of, refused, wait
from tests.web.conftest import Served, control_state, navigation_state


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
