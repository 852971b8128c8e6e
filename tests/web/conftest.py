"""A page server with a robot that only remembers what it is asked."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import deque
from pathlib import Path

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from robotctl.messages.control import (
    BusStatus,
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    SafetyState,
)
from robotctl.web.access import Access
from robotctl.web.config import WebConfig
from robotctl.web.desk import Desk
from robotctl.web.listening import PageHost, listen
from robotctl.web.robot_view import Now
from robotctl.web.server import PageServer, RobotSide
from robotctl.web.wire import ComputerState, RobotOutline
from tests.web.clients import TOKENS

OUTLINE = RobotOutline(
    name="robby",
    version="1",
    simulated=True,
    drive="differential",
    holonomic=False,
    has_lidar=False,
    has_localiser=False,
    bodies=((((0.2, -0.1), (0.2, 0.1), (-0.2, 0.1), (-0.2, -0.1)),),),
    sonars=(),
    v_max_m_s=0.8,
    omega_max_rad_s=2.5,
    vy_max_m_s=0.0,
)
PERIOD_S = 0.01


def control_state(state=SafetyState.ARMED, reason="", stamp_ns=None, **fields) -> ControlState:
    """Return a state of a robot that stands somewhere."""
    return ControlState(
        stamp_ns=time.monotonic_ns() if stamp_ns is None else stamp_ns,
        state=state,
        reason=reason,
        **dict.fromkeys(
            [
                "x_m",
                "y_m",
                "theta_rad",
                "v_m_s",
                "omega_rad_s",
                "v_ref_m_s",
                "omega_ref_rad_s",
                "distance_m",
                "steering_rad",
                "bus_voltage_v",
            ],
            0.0,
        ),
        **dict.fromkeys(
            [
                "wheel_rad_s",
                "wheel_ref_rad_s",
                "wheel_distance_m",
                "duty",
                "current_a",
                "temperature_c",
                "sonar_m",
                "sonar_stamp_ns",
                "nodes",
            ],
            (),
        ),
        battery=None,
        bus=BusStatus(),
        loop=LoopStatistics(),
        **fields,
    )


def navigation_state(mode=Mode.HOLD, message="") -> NavigationState:
    return NavigationState(time.monotonic_ns(), mode, "", 0, 0, "", False, False, message)


class FakeRobot:
    """What the server asks of the robot, and what the robot publishes."""

    def __init__(self) -> None:
        self.control: list = []
        self.navigation: list = []
        self.telemetry: list = []
        self.saved: list = []
        self.why_not_saved: Exception | None = None
        self.said: list[str] = []
        self.published: list[bytes] = []
        self.state = SafetyState.ARMED
        self.is_silent = False
        self.computer = lambda: ComputerState(0.5, 40.0, 1, 2, None)

    def side(self) -> RobotSide:
        return RobotSide(
            OUTLINE,
            self.now,
            self._take_control,
            self._take_navigation,
            self.said.append,
            self._take_telemetry,
            lambda _: True,
            self._save,
            computer=self._read_computer,
        )

    def _read_computer(self) -> ComputerState:
        return self.computer()

    def now(self) -> Now:
        now_ns = time.monotonic_ns()
        return Now(now_ns, now_ns)

    def _take_control(self, request) -> bool:
        self.control.append(request)
        return True

    def _take_navigation(self, request) -> bool:
        self.navigation.append(request)
        return True

    def _take_telemetry(self, request) -> bool:
        self.telemetry.append(request)
        return True

    def _save(self, values) -> tuple:
        if self.why_not_saved is not None:
            raise self.why_not_saved
        self.saved.append(values)
        return "robby.toml", "robby.toml.~1~", tuple(values)

    def publish(self, *messages: msgspec.Struct) -> None:
        self.published += [msgspec.msgpack.encode(each) for each in messages]

    def take_published(self) -> list[bytes]:
        state = [] if self.is_silent else [msgspec.msgpack.encode(control_state(self.state))]
        messages, self.published = [*state, *self.published], []
        return messages


class Served:
    """A server in a thread of its own."""

    def __init__(self, static: Path, tokens=None, allowed_hosts=(), certificate=None) -> None:
        self.robot = FakeRobot()
        self.listener = listen(WebConfig(port=0))
        self.port = self.listener.getsockname()[1]
        self.scheme = "http" if certificate is None else "https"
        self.url = f"{self.scheme}://127.0.0.1:{self.port}"
        self.access = Access(
            tokens or {}, allowed_hosts, self.port, is_https=certificate is not None
        )
        desk = Desk(has_localiser=False, arm_timeout_ns=10**9)
        self.page = PageServer(self.robot.side(), desk, self.access, static)
        self._host = PageHost(self.page.app, certificate, certificate)
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))

    async def _serve(self) -> None:
        serving = asyncio.create_task(self._host.serve([self.listener]))
        while not self._host.should_exit and not serving.done():
            self.page.relay(self.robot.take_published())
            await asyncio.sleep(PERIOD_S)
        await serving

    def __enter__(self):
        self._thread.start()
        deadline_s = time.monotonic() + 10.0
        while not self._host.started:
            assert time.monotonic() < deadline_s
            time.sleep(0.005)
        return self

    def __exit__(self, *_error) -> None:
        self._host.should_exit = True
        self._thread.join(10.0)
        assert not self._thread.is_alive()

    def client(self, path="/live", **options) -> Client:
        return Client(self, path, **options)


class Client:
    """A page, by the independent client of `websockets`."""

    def __init__(self, served: Served, path="/live", cookie="", origin=None, **options) -> None:
        headers = {"Cookie": cookie} if cookie else {}
        connection = connect(
            f"{served.url.replace('http', 'ws')}{path}",
            origin=served.url if origin is None else origin or None,
            additional_headers=headers,
            compression=None,
            close_timeout=1.0,
            **options,
        )
        self.ws = connection.__enter__()
        self.seen: list[dict] = []
        self.waiting: deque[dict] = deque()
        """Messages of the last frame that are not read yet."""
        self.offset_ms = 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_error) -> None:
        self.ws.close()

    def send(self, _kind: str, **fields) -> None:
        self.ws.send(msgspec.json.encode({"type": _kind, **fields}).decode())

    def read(self, kind: str, seconds=5.0, where=lambda _message: True) -> dict:
        """Return the next message of a kind."""
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0:
            with contextlib.suppress(TimeoutError):
                if not self.waiting:
                    self.waiting.extend(msgspec.msgpack.decode(self.ws.recv(timeout=left_s)))
                message = self.waiting.popleft()
                self.seen.append(message)
                if message["type"] == kind and where(message):
                    return message
        kinds = [each["type"] for each in self.seen[-20:]]
        raise AssertionError(f"no {kind} within {seconds} s, but {kinds}")

    def ended(self) -> ConnectionClosed:
        """Return how the server closed the connection, once it has."""
        try:
            while True:
                self.ws.recv(timeout=5.0)
        except ConnectionClosed as closed:
            return closed

    def synchronise(self) -> None:
        """Learn the server's clock, as pages do."""
        self.send("Ping", t=time.monotonic() * 1e3)
        pong = self.read("Pong")
        self.offset_ms = pong["server_ns"] / 1e6 - time.monotonic() * 1e3

    def at_ms(self) -> float:
        return time.monotonic() * 1e3 + self.offset_ms


@pytest.fixture
def static(tmp_path) -> Path:
    (tmp_path / "static").mkdir()
    (tmp_path / "static" / "index.html").write_text("<!doctype html><title>page</title>")
    (tmp_path / "static" / "page.js").write_text("1;")
    (tmp_path / "secret.js").write_text("secret")
    return tmp_path / "static"


@pytest.fixture
def served(static):
    with Served(static) as served:
        yield served


@pytest.fixture
def guarded(static):
    """A server that asks for tokens."""
    with Served(static, TOKENS) as served:
        yield served
