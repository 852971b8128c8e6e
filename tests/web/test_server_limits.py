"""The server in bad company: what floods, garbage and hung disks cost."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed

from robotctl.messages.control import (
    EmergencyStop,
)
from robotctl.web.access import Role
from robotctl.web.server import MAX_CLIENTS, MESSAGES_AT_ONCE, MESSAGES_PER_S
from robotctl.web.wire import ComputerState
from tests.web.clients import cookie_of, get, of, wait

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
