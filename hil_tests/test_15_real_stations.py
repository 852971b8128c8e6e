"""Ground stations as people use them drive the robot: MAVSDK, MAVProxy and dronekit, each in a
process of its own.

They are no dependency of robotctl. ROBOTCTL_STATIONS names the Python of a virtual environment with
what hil_tests/stations/requirements.txt says; ROBOTCTL_DRONEKIT that of one with `dronekit==2.9.2`
and `future`, whose pymavlink is another; ROBOTCTL_NODE a folder in which `npm install
node-mavlink@2.3.0` was run, a codec that others wrote.
"""

from __future__ import annotations

import json
import math
import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hil_tests.ground_station import GroundStation, mavlink
from hil_tests.rig import PATIENT_S, Rig
from robotctl.app.supervision.stack import CONTROL, NAVIGATION, TELEMETRY
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import Context, TelemetryRobot
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.service import catalogue_of
from robotctl.mavlink.services.registry import SERVICES
from robotctl.messages.control import Mode, SafetyState

PYTHON = os.environ.get("ROBOTCTL_STATIONS", "")
DRONEKIT = os.environ.get("ROBOTCTL_DRONEKIT", "")
NODE = os.environ.get("ROBOTCTL_NODE", "")
HERE = Path(__file__).parent / "stations"
LONGEST_S = 240.0
ORIGIN = Origin(48.13, 11.57, 520.0)
HOME, PLACES, GOAL = (2.0, 2.0), ((3.2, 2.2), (3.2, 3.0)), (2.6, 2.2)
"""In `world` [m]."""

needs_stations = pytest.mark.skipif(
    not PYTHON, reason="not run, no Python with MAVSDK and MAVProxy in ROBOTCTL_STATIONS"
)


def on_globe(place: tuple[float, float]) -> tuple[float, float]:
    return ORIGIN.from_world(*place)


@pytest.fixture
def robot(without_floods: None, make_rig: Callable[..., Rig]) -> Callable[..., tuple[Rig, int]]:
    """Return what starts a robot of a personality; the port of its TCP server comes with it."""

    def start(personality: str, record: str = "") -> tuple[Rig, int]:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        origin = f"{{latitude_deg={ORIGIN.latitude_deg},longitude_deg={ORIGIN.longitude_deg}}}"
        link = f'{{url="tcpin:127.0.0.1:{port}"}}'
        rig = make_rig(
            override=f'mavlink={{personality="{personality}",origin={origin},link=[{link}]}}',
            record=record,
        )
        rig.start_firmware()
        for module in (CONTROL, NAVIGATION, TELEMETRY):
            rig.start(module)
        rig.wait_for_state(SafetyState.STANDBY)
        rig.prefer(NAVIGATION, TELEMETRY)
        return rig, port

    return start


def steps_of(*command: str) -> tuple[dict[str, Any], str]:
    """Return the steps that a program tells of, and all that it says."""
    said = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    lines = (line for line in said.stdout.splitlines() if line.startswith('["'))
    return dict(json.loads(line) for line in lines), said.stdout + said.stderr


@needs_stations
@pytest.mark.timeout(2 * LONGEST_S)
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_a_program_of_mavsdk_does_all_with_it(
    robot: Callable[..., tuple[Rig, int]], personality: str
) -> None:
    rig, port = robot(personality)
    plan = {
        "home": on_globe(HOME),
        "places": [on_globe(place) for place in PLACES],
        "goto": on_globe(GOAL),
        "first": int(personality == "ardupilot"),
    }
    program = [PYTHON, str(HERE / "mavsdk_drive.py"), f"tcpout://127.0.0.1:{port}"]
    steps, output = steps_of(*program, json.dumps(plan))
    scaled = [[round(degrees * 1e7) for degrees in place] for place in plan["places"]]
    assert steps == {
        **dict.fromkeys(
            ("connect", "parameters", "set", "set whole", "upload", "download", "arm", "start"),
            "done",
        ),
        **dict.fromkeys(("goto", "return", "hold", "disarm", "clear"), "done"),
        **dict.fromkeys(("armable", "position", "complete", "there", "home", "disarmed"), True),
        "how many": steps["how many"],
        "set to": 0.35,
        "set whole to": 1500,
        "downloaded": scaled,
        "left": 0,
    }, output
    assert sum(steps["how many"]) > 50
    rig.wait_for_state(SafetyState.STANDBY)


@pytest.mark.skipif(not DRONEKIT, reason="not run, no Python with dronekit in ROBOTCTL_DRONEKIT")
@pytest.mark.timeout(2 * LONGEST_S)
def test_a_program_of_dronekit_does_all_with_it(robot: Callable[..., tuple[Rig, int]]) -> None:
    rig, port = robot("ardupilot")
    plan = {
        "home": on_globe(HOME),
        "places": [on_globe(place) for place in PLACES],
        "goto": on_globe(GOAL),
    }
    program = [DRONEKIT, str(HERE / "dronekit_drive.py"), f"tcp:127.0.0.1:{port}"]
    steps, output = steps_of(*program, json.dumps(plan))
    assert steps == {
        **dict.fromkeys(("connect", "upload", "goto", "clear"), "done"),
        **dict.fromkeys(("armable", "ekf", "position", "set to", "arm", "driven", "there"), True),
        **dict.fromkeys(("mode AUTO", "mode GUIDED", "mode RTL", "mode HOLD"), True),
        **dict.fromkeys(("home", "disarm"), True),
        "downloaded": [[round(degrees, 5) for degrees in place] for place in plan["places"]],
        "left": [],
    }, output
    rig.wait_for_state(SafetyState.STANDBY)


class Proxy:
    """MAVProxy on its command line."""

    def __init__(self, port: int, folder: Path) -> None:
        command = [PYTHON, "-m", "MAVProxy.mavproxy", f"--master=tcp:127.0.0.1:{port}"]
        self._process = subprocess.Popen(
            command, cwd=folder, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.append(line.rstrip())

    def expect(self, *words: str) -> None:
        """Wait until each of some words was said since the last command."""
        end_s = time.monotonic() + PATIENT_S
        while time.monotonic() < end_s:
            said = "\n".join(self._lines)
            if all(word in said for word in words):
                return
            time.sleep(0.1)
        raise AssertionError(f"not said: {words}\n" + "\n".join(self._lines))

    def enter(self, line: str, *words: str) -> None:
        """Enter a command, and wait for words of the answer."""
        self._lines.clear()
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        self.expect(*words)

    def close(self) -> None:
        self._process.kill()  # it takes no SIGTERM while it reads commands
        self._process.wait(PATIENT_S)
        self._reader.join(PATIENT_S)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def items(folder: Path, name: str, lines: list[tuple[float, ...]]) -> str:
    """Write a file of items as all stations read them; return its name."""
    text = ["QGC WPL 110"]
    for seq, (command, first, latitude_deg, longitude_deg) in enumerate(lines):
        place = f"{latitude_deg:.7f}\t{longitude_deg:.7f}\t0"
        text.append(f"{seq}\t0\t3\t{command}\t{first}\t0\t0\t0\t{place}\t1")
    (folder / name).write_text("\n".join(text) + "\n", encoding="ascii")
    return name


@needs_stations
@pytest.mark.timeout(2 * LONGEST_S)
def test_mavproxy_does_all_with_it(robot: Callable[..., tuple[Rig, int]], tmp_path: Path) -> None:
    record = tmp_path / "record"
    record.mkdir()
    for age_s, name in ((100, "newest.mcap"), (200, "before.mcap")):
        (record / name).write_bytes(name.encode() * 100)
        os.utime(record / name, (time.time() - age_s, time.time() - age_s))
    rig, port = robot("ardupilot", str(record))
    proxy = Proxy(port, tmp_path)
    try:
        proxy.expect("Mode HOLD", "Received ", "parameters (ftp)")
        proxy.enter("param set CRUISE_SPEED 0.45", "Parameter CRUISE_SPEED: 0.4 -> 0.45")
        corners = [(5001, 4, *on_globe(each)) for each in ((0.6, 0.6), (4.2, 0.6), (4.2, 4.2))]
        corners.append((5001, 4, *on_globe((0.6, 4.2))))
        fence = items(tmp_path, "fence.txt", corners)
        proxy.enter(f"fence load {fence}", "TYPE_FENCE: ACCEPTED", "fence present")
        rally = items(tmp_path, "rally.txt", [(5100, 0, *on_globe(GOAL))])
        proxy.enter(f"rally load {rally}", "TYPE_RALLY: ACCEPTED")
        proxy.enter("rally list", "5100 3 ", "Saved 1 rally items")
        way = [(16, 0, *on_globe(HOME)), *((16, 0, *on_globe(each)) for each in PLACES)]
        proxy.enter(f"wp load {items(tmp_path, 'way.txt', way)}", "TYPE_MISSION: ACCEPTED")
        proxy.enter("wp list", "Saved 3 waypoints")
        proxy.enter("mode AUTO", "DO_SET_MODE: ACCEPTED", "Mode AUTO")
        proxy.enter("arm throttle", "COMPONENT_ARM_DISARM: ACCEPTED")
        rig.wait(
            lambda: rig.navigation is not None and rig.navigation.mission_completed,
            LONGEST_S, "the mission is complete",
        )  # fmt: skip
        proxy.enter("mode RTL", "Mode RTL")
        rig.wait(lambda: _is_at(rig, HOME), PATIENT_S, "the robot is home")
        proxy.enter("disarm", "COMPONENT_ARM_DISARM: ACCEPTED")
        rig.wait_for_state(SafetyState.STANDBY)
        proxy.enter("log list", "Log 1  numLogs 2 lastLog 2 size 1100", "Log 2  numLogs 2")
        proxy.enter("log download latest", "Finished downloading log2.bin (1100 bytes")
        assert (tmp_path / "log2.bin").read_bytes() == b"newest.mcap" * 100
    finally:
        proxy.close()


def _is_at(rig: Rig, place: tuple[float, float]) -> bool:
    truth, mode = rig.fresh_truth(), rig.navigation and rig.navigation.mode
    gap_m = abs(complex(truth.x_m, truth.y_m) - complex(*place))
    return mode is Mode.RTL and gap_m < 0.3


@pytest.mark.skipif(not NODE, reason="not run, no node-mavlink in ROBOTCTL_NODE")
def test_a_codec_that_others_wrote_reads_each_message_field_by_field(
    make_station: Callable[..., GroundStation],
) -> None:
    station = make_station(
        override=f"mavlink.origin={{latitude_deg={ORIGIN.latitude_deg},longitude_deg=11.57}}"
    )
    context = Context(MavlinkConfig(), TelemetryRobot(), SimpleNamespace(count=0))
    streams = catalogue_of([make(context) for make in SERVICES]).streams
    for number, stream in streams.items():
        if stream.rate_hz is not None:
            station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 500_000)
    for number in streams:
        station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number)
    found = {}
    end_s = time.monotonic() + 3.0
    while time.monotonic() < end_s:
        message = station.link.recv_match(blocking=True, timeout=0.1)
        if message is not None:
            found[message.get_msgId()] = message
    messages = list(found.values())
    frames = "\n".join(bytes(message.get_msgbuf()).hex() for message in messages)
    read = subprocess.run(
        ["node", str(HERE / "read_frames.cjs")],
        input=frames, capture_output=True, text=True, timeout=60.0, check=False,
        env={**os.environ, "NODE_PATH": str(Path(NODE) / "node_modules")},
    )  # fmt: skip
    assert read.returncode == 0, read.stderr
    answers = [json.loads(line) for line in read.stdout.splitlines()]
    known = [pair for pair in zip(messages, answers, strict=True) if pair[1] is not None]
    assert len(known) > 20
    for message, (name, fields) in known:
        assert name == message.get_type()
        expected = {key: plain(value) for key, value in message.to_dict().items()}
        del expected["mavpackettype"]
        found = {key: plain(value) for key, value in fields.items()}
        # Either may have fields that were added later: nothing is in those.
        added = found.keys() - expected.keys()
        assert not any(found.pop(key) for key in added), name
        assert found == {key: value for key, value in expected.items() if key in found}, name
        assert len(found) > 0.7 * len(expected), name


def plain(value: object) -> object:
    """Return a field in one form: not all write numbers, text and arrays alike."""
    if isinstance(value, list | tuple | bytearray):
        return [plain(each) for each in value]
    if isinstance(value, str):
        text = value.rstrip("\0")
        return text.lower() if text.lower() in {"nan", "infinity", "-infinity"} else text
    if isinstance(value, float) and not math.isfinite(value):
        return {math.inf: "infinity", -math.inf: "-infinity"}.get(value, "nan")
    return float(value) if isinstance(value, int | float) else value
