"""Two ground stations on a simulated robot: what their streams cost, and how soon one knows all.

Both are pymavlink's, over TCP. What QGroundControl asks for when it connects is asked here one
after the other: version, modes, parameters, mission, fence, rally
points and home.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import machine
from robotctl.app.supervision.stack import TELEMETRY

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "all"
from pymavlink import mavutil

mavlink = mavutil.mavlink
CONNECT_S = 6.0
SHARE = 0.05
ORIGIN = "mavlink.origin={latitude_deg=48.1,longitude_deg=11.5}"
"""Without it there is no home on the globe."""
PATIENT_S = 5.0


class Station:
    """A client with its heartbeat."""

    def __init__(self, port: int, system: int) -> None:
        self.link = mavutil.mavlink_connection(
            f"tcp:127.0.0.1:{port}", source_system=system, retries=60
        )
        self._beat_s = 0.0
        self.messages = 0

    def wait(self, kinds: tuple[str, ...], seconds: float = PATIENT_S) -> Any:
        """Return the next message of a kind; None after a while."""
        end_s = time.monotonic() + seconds
        while (now_s := time.monotonic()) < end_s:
            if now_s - self._beat_s > 1.0:
                self._beat_s = now_s
                self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0)
            message = self.link.recv_match(blocking=True, timeout=min(0.1, end_s - now_s))
            if message is not None:
                self.messages += 1
                if message.get_type() in kinds:
                    return message
        return None

    def ask(self, number: int) -> Any:
        """Ask for a message; return it."""
        command = mavlink.MAV_CMD_REQUEST_MESSAGE
        self.link.mav.command_long_send(1, 1, command, 0, number, 0, 0, 0, 0, 0, 0)
        name = mavlink.mavlink_map[number].msgname
        return self.wait((name,))


def known(station: Station) -> list[tuple[str, float]]:
    """Return when each thing was known after the heartbeat [s]."""
    begin_s = time.monotonic()
    steps: list[tuple[str, Callable[[], bool]]] = [
        ("heartbeat", lambda: station.wait(("HEARTBEAT",)) is not None),
        ("version", lambda: station.ask(148) is not None),
        ("modes", lambda: _modes(station)),
        ("parameters", lambda: _parameters(station)),
        *((name, lambda kind=kind: _plan(station, kind)) for kind, name in enumerate(PLANS)),
        ("home", lambda: station.ask(242) is not None),
    ]
    times = []
    for name, step in steps:
        if not step():
            raise RuntimeError(f"{name}: no answer")
        times.append((name, time.monotonic() - begin_s))
    return times


PLANS = ("mission", "fence", "rally points")


def _modes(station: Station) -> bool:
    first = station.ask(435)
    return first is not None and first.number_modes > 3


def _parameters(station: Station) -> bool:
    """List them; True if all came."""
    station.link.mav.param_request_list_send(1, 1)
    indices: set[int] = set()
    while message := station.wait(("PARAM_VALUE",)):
        indices.add(message.param_index)
        if len(indices) >= message.param_count:
            return True
    return False


def _plan(station: Station, kind: int) -> bool:
    """Download a plan; True if all came."""
    station.link.mav.mission_request_list_send(1, 1, kind)
    count = station.wait(("MISSION_COUNT",))
    if count is None:
        return False
    for number in range(count.count):
        station.link.mav.mission_request_int_send(1, 1, number, kind)
        if station.wait(("MISSION_ITEM_INT",)) is None:
            return False
    station.link.mav.mission_ack_send(1, 1, 0, kind)
    return True


def run(_rounds: int, seconds: float) -> None:
    """Connect a station, then measure with two of them."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = f'mavlink.link=[{{url="tcpin:127.0.0.1:{port}"}}]'
    command = [sys.executable, "-m", "robotctl", "sim", "--mission", "patrol", "--headless"]
    with subprocess.Popen(
        [*command, "--localiser", "none", "--set", link, "--set", ORIGIN], stdout=subprocess.DEVNULL
    ) as robot:
        try:
            first = Station(port, 255)
            first.link.close()
            idle = _share(_telemetry(robot.pid), lambda: time.sleep(seconds))
            stations = [Station(port, 255), Station(port, 254)]
            times = known(stations[0])
            machine.table(
                "What a ground station knows, after", ("", "s"), [(n, f"{t:.2f}") for n, t in times]
            )
            machine.note(f"{times[-1][1] / CONNECT_S:.2f} of the {CONNECT_S:g} s allowed")
            _measure(stations, _telemetry(robot.pid), idle, seconds)
        finally:
            robot.terminate()
            robot.wait(30.0)


def _measure(stations: list[Station], pid: int, idle: float, seconds: float) -> None:
    """Read all streams for a while."""
    readers = [
        threading.Thread(target=each.wait, args=((), seconds), daemon=True) for each in stations
    ]

    def read() -> None:
        for each in readers:
            each.start()
        for each in readers:
            each.join()

    before = _count(stations)
    share = _share(pid, read)
    rate = (_count(stations) - before) / seconds
    machine.note(
        f"telemetry: {100.0 * idle:.1f} % of a core without a station, {100.0 * share:.1f} % with "
        f"two, {rate:.0f} messages a second in all; {(share - idle) / SHARE:.2f} of the "
        f"{100.0 * SHARE:g} % allowed for their streams"
    )


def _share(pid: int, work: Callable[[], None]) -> float:
    """Return how much of a core a process takes while something is done."""
    cpu_s, begin_s = _cpu_s(pid), time.monotonic()
    work()
    return (_cpu_s(pid) - cpu_s) / (time.monotonic() - begin_s)


def _count(stations: list[Station]) -> int:
    return sum(each.messages for each in stations)


def _telemetry(parent: int) -> int:
    """Return the telemetry process of a simulation."""
    for status in Path("/proc").glob("[0-9]*/cmdline"):
        words = status.read_bytes().split(b"\0")
        if TELEMETRY.encode() in words and _parent(status.parent) == parent:
            return int(status.parent.name)
    raise RuntimeError("no telemetry process")


def _parent(process: Path) -> int:
    return int((process / "stat").read_text(encoding="ascii").rpartition(")")[2].split()[1])


def _cpu_s(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
