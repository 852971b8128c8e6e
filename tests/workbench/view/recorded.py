"""A run whose every message is known, recorded as the recorder does, and served."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections import deque
from contextlib import ExitStack
from pathlib import Path

import msgspec
import numpy as np
from websockets.sync.client import connect

from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.scene import Scene
from robotctl.messages.control import (
    BatteryFeedback,
    BusStatus,
    ControlState,
    LoopStatistics,
    NavigationState,
    NodeStatus,
    Notice,
    SafetyState,
)
from robotctl.messages.estimation import (
    GivenMap,
    LidarScan,
    LocalisationState,
    ParticleCloud,
    PlanView,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.mode import Mode
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.sensors.sonar import SonarMount
from robotctl.web.access import Access
from robotctl.web.config import WebConfig
from robotctl.web.listening import PageHost, listen
from robotctl.workbench.view.run import ReplayedRun
from robotctl.workbench.view.server import ReplayServer
from tests.web.page.served_robot import MAP_M, STATIC, walled_map

EPOCH_NS = 1_700_000_000_000_000_000
PERIOD_NS = 50_000_000
DRIVES_S = 2.0
"""When it begins to drive [s]."""
FAULT_S = 14.0
"""When a fault stops it [s]."""
LOST_S = 10.0, 12.0
"""While it does not know its place [s]."""
SPEED_M_S = 0.3


def pose_at(t_s: float) -> tuple[float, float, float]:
    """Return where it is: it drives along x of the room's middle [m, m, rad]."""
    return 1.0 + SPEED_M_S * (min(max(t_s, DRIVES_S), FAULT_S) - DRIVES_S), MAP_M[1] / 2, 0.0


def published(seconds: float) -> list[Published]:
    """Return everything that the robot publishes, in its order."""
    messages: list[Published] = [GivenMap(0, walled_map()), Notice(0, 5, "it begins")]
    for number in range(round(seconds * 1e9 / PERIOD_NS)):
        at_ns = number * PERIOD_NS
        messages += [_localisation(at_ns), _control(at_ns)]
        if number % 2 == 0:
            messages.append(NavigationState(at_ns, Mode.AUTO, "m", 1, 3, "item", False, False, ""))
            ranges = np.full(90, 1.0 + at_ns / 1e11, np.float32)
            ranges[:2] = math.inf, math.nan
            messages.append(LidarScan(at_ns, 0.1, 0.0, 0.0, 0.05, 8.0, ranges.tobytes()))
        if number % 10 == 0:
            cloud = np.random.default_rng(number).uniform(1.0, 5.0, (20, 3)).astype(np.float32)
            messages.append(ParticleCloud(at_ns, cloud.tobytes()))
            path = np.array([pose_at(at_ns / 1e9), (7.0, 3.0, 0.0)], np.float32)
            costs = msgspec.structs.replace(walled_map(), stamp_ns=at_ns)
            messages.append(PlanView(at_ns, path.tobytes(), b"", b"", (), costs))
        if at_ns == FAULT_S * 1e9:
            messages.append(Notice(at_ns, 3, "the motor is hot"))
    return messages


def _control(at_ns: int) -> ControlState:
    t_s = at_ns / 1e9
    x_m, y_m, theta_rad = pose_at(t_s)
    drives = DRIVES_S <= t_s < FAULT_S
    state = SafetyState.DRIVING if drives else SafetyState.ARMED
    fault = t_s >= FAULT_S
    return ControlState(
        stamp_ns=at_ns,
        state=SafetyState.FAULT if fault else state,
        reason="the motor is hot" if fault else "",
        x_m=x_m,
        y_m=y_m,
        theta_rad=theta_rad,
        v_m_s=SPEED_M_S if drives else 0.0,
        omega_rad_s=math.nan,
        v_ref_m_s=math.sin(t_s),
        omega_ref_rad_s=0.0,
        distance_m=t_s,
        wheel_rad_s=(1.0, 2.0),
        wheel_ref_rad_s=(1.0, 2.0),
        wheel_distance_m=(0.0, 0.0),
        duty=(0.1, 0.001 * t_s),
        current_a=(),
        temperature_c=(30.0, 31.0),
        steering_rad=0.0,
        bus_voltage_v=12.0,
        battery=BatteryFeedback(at_ns, 12.1, 1.0, 0.8, 25.0, low=False, critical=False),
        sonar_m=(1.5, math.inf, math.nan),
        sonar_stamp_ns=(at_ns, 0, 0),
        nodes=(NodeStatus(1, "drive", 5, at_ns, 1, ""),),
        bus=BusStatus(load=0.12),
        loop=LoopStatistics(rate_hz=200.0, lag_us_p99=150.0),
        fault=FaultCode.DRIVE_OVER_TEMPERATURE if fault else FaultCode.NONE,
        against_arming=(Fault(FaultCode.DRIVE_OVER_TEMPERATURE, "hot"),) if fault else (),
        odom_epoch_ns=7,
    )


def _localisation(at_ns: int) -> LocalisationState:
    is_lost = LOST_S[0] <= at_ns / 1e9 < LOST_S[1]
    status = LocalisationStatus.LOST if is_lost else LocalisationStatus.LOCALISED
    covariance = (0.01, 0.0, 0.0, 0.04, 0.0, 0.01)
    # A lost localiser guesses: nobody may follow that.
    x_m = 3.0 if is_lost else 0.0
    return LocalisationState(
        at_ns, "mcl", status, x_m, 0.0, 0.0, covariance, 20, odom_epoch_ns=7, epoch_ns=9
    )


def write_run(
    folder: Path, seconds: float, *, files: int = 1, begin_ns: int = EPOCH_NS, is_cut: bool = False
) -> Path:
    """Record a run, in several files one after the other; `is_cut`: the last is not closed."""
    folder.mkdir(exist_ok=True)
    scene = Scene([SonarMount("front", 0.3, 0.0, 0.0)], has_localiser=True)
    messages = published(seconds)
    first = 1 + len(list(folder.glob("robot-*.mcap")))
    for number in range(files):
        part = messages[len(messages) * number // files : len(messages) * (number + 1) // files]
        with (folder / f"robot-{first + number:04d}.mcap").open("wb") as file:
            log = McapLog(file, begin_ns, "tester", scene)
            flushed_ns = part[0].stamp_ns
            for message in part:
                log.add(message)
                if message.stamp_ns - flushed_ns >= 1_000_000_000:
                    flushed_ns = message.stamp_ns
                    log.flush()
            if is_cut and number == files - 1:
                log.flush()
            else:
                log.close()
    return folder


class ServedReplay:
    """Recordings behind the real server, in a thread of their own."""

    def __init__(self, *paths: Path) -> None:
        self._stack = ExitStack()
        with ExitStack() as until_open:
            until_open.push(self._stack)
            self.runs = [ReplayedRun(each, self._stack) for each in paths]
            until_open.pop_all()
        self._listener = self._stack.enter_context(listen(WebConfig(port=0)))
        self.port = self._listener.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        self._host = PageHost(ReplayServer(self.runs, Access({}, (), self.port), STATIC).app)
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._host.serve([self._listener]))
        )

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
        self._stack.close()

    def client(self, path="/live", origin=None) -> ReplayClient:
        return ReplayClient(self, path, origin)


class ReplayClient:
    """A page, by the independent client of `websockets`."""

    def __init__(self, served: ServedReplay, path: str, origin: str | None) -> None:
        address = served.url.replace("http", "ws").rstrip("/")
        origin = served.url.rstrip("/") if origin is None else origin
        self._connection = connect(f"{address}{path}", origin=origin, compression=None)
        self._waiting: deque[dict] = deque()
        self.known: dict[str, dict] = {}
        self.hello: dict = {}

    def __enter__(self):
        self._connection.__enter__()
        self.hello = self.receive()
        return self

    def __exit__(self, *error) -> None:
        self._connection.__exit__(*error)

    def send(self, _kind: str, **fields) -> None:
        self._connection.send(msgspec.json.encode({"type": _kind, **fields}).decode())

    def receive(self) -> dict:
        """Return the next message."""
        if not self._waiting:
            self._waiting.extend(msgspec.msgpack.decode(self._connection.recv(timeout=10.0)))
        return self._waiting.popleft()

    def picture(self, where=lambda _playback: True) -> dict[str, dict]:
        """Return the messages that are known with the next time shown, and that itself."""
        while True:
            message = self.receive()
            self.known[message["type"]] = message
            if message["type"] == "Playback" and where(message):
                return {each: self.known[each] for each in (*message["topics"], "Playback")}

    def seek(self, at_ns: int) -> dict[str, dict]:
        """Return the picture of a time."""
        self.send("Seek", at_ns=at_ns)
        return self.picture(lambda playback: playback["at_ns"] == at_ns)

    def closed(self) -> str:
        """Return why the server closed the connection."""
        with contextlib.suppress(TimeoutError):
            try:
                while True:
                    self._connection.recv(timeout=5.0)
            except Exception as error:  # noqa: BLE001 - of the client's library
                return str(error)
        raise AssertionError("still open")
