"""The web page's server: what a robot that publishes a lot costs it, and how soon a stop works.

The peer is foxglove-sdk's server in a Python process of its own, which takes the same messages from
the same sockets, and hands them on as they are.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import zmq
from websockets.asyncio.client import connect

from benchmarks import machine
from benchmarks.rig import Driven
from benchmarks.slow_link import slow_link
from hil_tests.browser import Page
from hil_tests.rig import Rig
from robotctl.app.supervision.stack import WEB
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.messages.control import (
    BusStatus,
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    SafetyState,
)
from robotctl.messages.estimation import (
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
)
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.runtime.ipc.topics import Endpoints, Publisher, endpoint_directory
from robotctl.web.links import read_links

RATE_HZ: Final = 20
CONTROL_HZ: Final = 50
PARTICLES, BEAMS, CELLS = 2000, 720, 200
SHARES: Final = {0: "-", 1: "2", 3: "3"}
"""Goals by the number of clients [% of a core]."""
MEMORY_MIB: Final = 80
CLICKS: Final = 200
STOP_MS: Final = 100
LINK_BIT_S, LINK_S = 1e6, 0.1
"""Rate and time there and back of a slow link [bit/s, s]."""
LAG_CLIENTS: Final = 5
_LONG_ARRAY: Final = 0xDC
PEER: Final = "peer"


class Published:
    """A robot that publishes and does nothing else."""

    def __init__(self, name: str) -> None:
        self._context: zmq.Context[Any] = zmq.Context()
        endpoints = Endpoints(endpoint_directory(name))
        self._control = Publisher(self._context, endpoints.control_state)
        self._navigation = Publisher(self._context, endpoints.navigation_state)
        self._lidar = Publisher(self._context, endpoints.lidar)
        self._cells = np.random.default_rng(1).integers(0, 100, CELLS * CELLS, dtype=np.int8)
        self._poses = np.random.default_rng(2).normal(size=(PARTICLES, 3)).astype("<f4").tobytes()
        self._ranges = np.random.default_rng(3).uniform(0.1, 8.0, BEAMS).astype("<f4").tobytes()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Published:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()
        self._context.destroy(linger=0)

    def _run(self) -> None:
        tick, period_s = 0, 0.01
        deadline_s = time.monotonic()
        while not self._ended.is_set():
            now_ns = time.monotonic_ns()
            if tick % (100 // CONTROL_HZ) == 0:
                self._control.send(_control_state(now_ns, tick * 0.001))
            if tick % (100 // RATE_HZ) == 0:
                self._publish(now_ns)
            if tick % 100 == 0:
                self._navigation.send(self._map(now_ns, CELLS))
            tick += 1
            deadline_s += period_s
            time.sleep(max(0.0, deadline_s - time.monotonic()))

    def _publish(self, now_ns: int) -> None:
        """Publish what comes with each step of navigation."""
        self._lidar.send(LidarScan(now_ns, 0.1, 0.0, -3.14, 6.28 / BEAMS, 8.0, self._ranges))
        self._navigation.send(
            NavigationState(now_ns, Mode.AUTO, "patrol", 1, 5, "goto", False, False, "1.2 m to go")
        )
        place = (0.1, 0.2, 0.3), (0.01, 0.0, 0.0, 0.01, 0.0, 0.01)
        self._navigation.send(
            LocalisationState(now_ns, "mcl", LocalisationStatus.LOCALISED, *place[0], place[1])
        )
        self._navigation.send(ParticleCloud(now_ns, self._poses))
        path = self._poses[:2400]
        self._navigation.send(PlanView(now_ns, path, path[:360], b"", (), self._map(now_ns, 60)))

    def _map(self, now_ns: int, side: int) -> LiveMap:
        cells = self._cells[: side * side].tobytes()
        return LiveMap(now_ns, side, side, 0.05, 0.0, 0.0, cells)


def _control_state(now_ns: int, x_m: float) -> ControlState:
    four, eight = (0.1,) * 4, (1.5,) * 8
    return ControlState(
        now_ns, SafetyState.DRIVING, "", x_m, 0.0, 0.0, 0.4, 0.1, 0.4, 0.1, x_m, four, four, four,
        four, four, four, 0.0, 24.0, None, eight, (now_ns,) * 8, (), BusStatus(), LoopStatistics(),
    )  # fmt: skip


# The peer


def serve_as_peer(name: str, port: int) -> None:
    """Hand the same messages on by foxglove-sdk until killed."""
    import foxglove

    context: zmq.Context[Any] = zmq.Context()
    endpoints = Endpoints(endpoint_directory(name))
    socket = context.socket(zmq.SUB)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    for address in (endpoints.control_state, endpoints.navigation_state, endpoints.lidar):
        socket.connect(address)
    foxglove.start_server(port=port)
    channels: dict[bytes, Any] = {}
    while True:
        data = socket.recv()
        kind = data[data.index(b"type") + 4 :][:14]
        if kind not in channels:
            topic = kind[1 : 1 + (kind[0] & 31)].decode()
            schema = foxglove.Schema(name=topic, encoding="", data=b"")
            channels[kind] = foxglove.Channel(
                f"/{topic}", message_encoding="msgpack", schema=schema
            )
        channels[kind].log(data)


# Clients


def read_all(url: str, count: int, seconds: float, *, of_peer: bool) -> None:
    """Read as so many pages for a while; print how many messages came."""
    print(asyncio.run(_read_all(url, count, seconds, of_peer=of_peer)))  # noqa: T201


async def _read_all(url: str, count: int, seconds: float, *, of_peer: bool) -> int:
    read = _read_peer if of_peer else _read_page
    return sum(await asyncio.gather(*(read(url, seconds) for _ in range(count))))


async def _read_page(url: str, seconds: float) -> int:
    count = 0
    address = url.replace("http", "ws", 1).rstrip("/") + "/live"
    async with connect(address, origin=url.rstrip("/"), compression=None) as page:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while True:
                    count += _length(await page.recv())
    return count


def _length(frame: bytes) -> int:
    """Return the number of messages in a frame: an array of MessagePack."""
    return frame[0] & 15 if frame[0] != _LONG_ARRAY else int.from_bytes(frame[1:3], "big")


async def _read_peer(url: str, seconds: float) -> int:
    count = 0
    protocol = ["foxglove.sdk.v1"]
    async with connect(url, subprotocols=protocol, compression=None) as page:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while True:
                    message = await page.recv()
                    if isinstance(message, bytes):
                        count += 1
                        continue
                    told = json.loads(message)
                    if told["op"] == "advertise":
                        wanted = [
                            {"id": each["id"], "channelId": each["id"]} for each in told["channels"]
                        ]
                        await page.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return count


# Measuring


def run(rounds: int, seconds: float) -> None:
    """Measure load and memory beside the peer, the control loop beside clients, then stops."""
    name = f"bench-web-{os.getpid()}"
    rows = []
    servers = {"robotctl": _served, "foxglove-sdk": _served_by_peer}
    if importlib.util.find_spec("foxglove") is None:
        machine.note("foxglove-sdk: not run: it is not installed")
        del servers["foxglove-sdk"]
    with Published(name):
        for kind, serve in servers.items():
            with serve(name) as (pid, url):
                time.sleep(3.0)
                for count, goal in SHARES.items():
                    share, messages = _share(pid, url, count, seconds, of_peer=kind != "robotctl")
                    rows.append(
                        (f"{kind}, {count} clients", f"{100 * share:.1f}", goal,
                         f"{messages / seconds / max(count, 1):.0f}", f"{_resident_mib(pid):.0f}")
                    )  # fmt: skip
    machine.table(
        "Server",
        ("", "% of a core", "goal", "messages a second and client", f"MiB (goal {MEMORY_MIB})"),
        rows,
    )
    machine.table(
        f"Control loop beside {LAG_CLIENTS} clients, {rounds} rounds in turn, medians",
        ("", "lag p50 us", "p99 us", "p99.9 us", "greatest us", "overruns"),
        list(_lags(rounds, seconds)),
    )
    machine.table(
        f"Stop: from the click to wheels without power, {CLICKS} clicks, goal {STOP_MS} ms",
        ("", "p50 ms", "p99 ms", "most ms"),
        list(_stops()),
    )


@contextlib.contextmanager
def _served(name: str) -> Iterator[tuple[int, str]]:
    options = StackOptions(
        instance=name,
        robot=str(find_file("diff_drive").resolve()),
        overrides=("web={enabled=true,port=0}", "mavlink.link=[]"),
    ).validated()
    links = Endpoints(endpoint_directory(name)).web_links
    with subprocess.Popen(options.command(WEB), stdin=subprocess.DEVNULL) as process:
        try:
            while (told := read_links(links)) is None:
                time.sleep(0.05)
            yield process.pid, told.address
        finally:
            process.terminate()


@contextlib.contextmanager
def _served_by_peer(name: str) -> Iterator[tuple[int, str]]:
    port = 18765
    command = [sys.executable, "-m", "benchmarks.web", PEER, name, str(port)]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as process:
        try:
            yield process.pid, f"ws://127.0.0.1:{port}"
        finally:
            process.terminate()


def _share(pid: int, url: str, count: int, seconds: float, *, of_peer: bool) -> tuple[float, int]:
    """Return how much of a core a server takes for so many clients, and what they were sent."""
    if not count:
        before_s, begin_s = _cpu_s(pid), time.monotonic()
        time.sleep(seconds)
        return (_cpu_s(pid) - before_s) / (time.monotonic() - begin_s), 0
    whole_s = seconds + 2.0
    words = ["clients", url, str(count), str(whole_s), str(int(of_peer))]
    command = [sys.executable, "-m", "benchmarks.web", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as clients:
        time.sleep(1.5)
        before_s, begin_s = _cpu_s(pid), time.monotonic()
        time.sleep(seconds)
        share = (_cpu_s(pid) - before_s) / (time.monotonic() - begin_s)
        said, _ = clients.communicate()
    return share, round(int(said) * seconds / whole_s)


def _cpu_s(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_mib(pid: int) -> float:
    text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024


# The control loop


def _lags(rounds: int, seconds: float) -> Iterator[tuple[str, ...]]:
    """Yield rows: without the page, and with clients that read all."""
    found: dict[str, list[LoopStatistics]] = {"no page": [], f"{LAG_CLIENTS} clients": []}
    for _ in range(rounds):
        for name, loops in found.items():
            with (
                Driven(200) as robot,
                _read_by(robot.instance, 0 if name == "no page" else LAG_CLIENTS),
            ):
                loops.append(robot.drive(seconds).loop)
    for name, loops in found.items():
        figures = [
            [each.lag_us_p50, each.lag_us_p99, each.lag_us_p999, each.lag_us_max, each.overruns]
            for each in loops
        ]
        yield name, *(f"{machine.median(column):.0f}" for column in zip(*figures, strict=True))


@contextlib.contextmanager
def _read_by(name: str, count: int) -> Iterator[None]:
    """Serve a robot's page to so many clients, in a process beside it; 0: no page."""
    if not count:
        yield
        return
    with _served(name) as (_pid, url):
        words = ["clients", url, str(count), "1e6", "0"]
        with subprocess.Popen([sys.executable, "-m", "benchmarks.web", *words]) as clients:
            try:
                yield
            finally:
                clients.kill()


# Stops


def _stops() -> Iterator[tuple[str, str, str, str]]:
    """Yield rows: a client alone, three, and beside one that floods."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig("simcan", Path(folder), 1, override="web={enabled=true,port=0}")
        try:
            rig.start_firmware()
            rig.start()
            rig.start(WEB)
            rig.wait(lambda: read_links(rig.endpoints.web_links), 30.0, "the page is served")
            links = read_links(rig.endpoints.web_links)
            assert links is not None
            url = links.address
            yield _clicks("no page: a request of a process", rig, url, _nobody, by_page=False)
            yield _clicks("1 client", rig, url, _nobody)
            yield _clicks("3 clients", rig, url, _two_more)
            with slow_link(links.port, LINK_BIT_S, 0.5 * LINK_S) as port:
                name = f"1 client over {LINK_BIT_S / 1e6:g} Mbit/s and {1e3 * LINK_S:g} ms"
                yield _clicks(name, rig, url, _nobody, port=port)
            yield _clicks("3 clients and one that floods", rig, url, _flood)
        finally:
            rig.close()


def _clicks(
    name: str,
    rig: Rig,
    url: str,
    beside: Callable[[str], contextlib.AbstractContextManager[None]],
    *,
    by_page: bool = True,
    port: int | None = None,
) -> tuple[str, str, str, str]:
    times = []
    with Page(url, port=port), Page(url, "/stop", port) as stop, beside(url):
        for number in range(CLICKS):
            while rig.control is None or rig.control.state is not SafetyState.DRIVING:
                rig.arm()
                rig.drive(0.0, 1.0, 0.15)
            rig.at_any_moment()
            asked_ns = time.monotonic_ns()
            if by_page:
                stop.send("Stop", id=number)
            else:
                rig.emergency_stop()
            rig.wait(
                lambda since_ns=asked_ns: rig.truth and rig.truth.power_off_ns > since_ns,
                5.0,
                "the wheels lose their power",
            )
            rig.wait_for_state(SafetyState.EMERGENCY_STOP)
            assert rig.truth is not None
            times.append((rig.truth.power_off_ns - asked_ns) / 1e6)
    p99 = statistics.quantiles(times, n=100)[98]
    return name, f"{machine.median(times):.1f}", f"{p99:.1f}", f"{max(times):.1f}"


@contextlib.contextmanager
def _nobody(_url: str) -> Iterator[None]:
    yield


@contextlib.contextmanager
def _two_more(url: str) -> Iterator[None]:
    with Page(url), Page(url):
        yield


@contextlib.contextmanager
def _flood(url: str) -> Iterator[None]:
    """Let a client send as fast as it can, and come back whenever it is cut off.

    It is nice: a client elsewhere takes no time of this computer.
    """
    command = [sys.executable, "-m", "benchmarks.web", "flood", url]
    with _two_more(url), subprocess.Popen(command) as flooding:
        try:
            time.sleep(1.0)
            yield
        finally:
            flooding.kill()


async def _flood_for_ever(url: str) -> None:
    text = json.dumps({"type": "Ping", "t": 1.0})
    address = url.replace("http", "ws", 1).rstrip("/") + "/live"
    while True:
        with contextlib.suppress(Exception):
            async with connect(address, origin=url.rstrip("/"), compression=None) as page:
                while True:
                    await page.send(text)


def main() -> None:
    """Be one of the processes of this benchmark."""
    what, *words = sys.argv[1:]
    if what == PEER:
        serve_as_peer(words[0], int(words[1]))
    elif what == "flood":
        os.nice(19)
        asyncio.run(_flood_for_ever(words[0]))
    else:
        read_all(words[0], int(words[1]), float(words[2]), of_peer=words[3] == "1")


if __name__ == "__main__":
    main()
