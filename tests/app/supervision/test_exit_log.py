"""Ends and pauses of processes, and where they are told."""

import contextlib
import json
import os
import signal
import socket
import time
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from pymavlink.dialects.v20 import common

from robotctl.app.supervision.stack import (
    CONTROL,
    NAVIGATION,
    RECORDER,
    ROLES,
    TELEMETRY,
)
from tests.app.supervision.bench import DEADLINE_S, Ear, Run, wait


class Station:
    """A ground station that collects what it is told, put together from its chunks."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.texts: list[str] = []
        self._mav = common.MAVLink(None, 255, 190)
        self._chunks: dict[int, str] = {}
        self._beat_s = 0.0

    def heard(self, words: str) -> bool:
        if time.monotonic() - self._beat_s > 0.5:
            self._beat_s = time.monotonic()
            with contextlib.suppress(ConnectionRefusedError):
                self.socket.send(common.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(self._mav))
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while True:
                for message in self._mav.parse_buffer(self.socket.recv(4096)) or ():
                    if message.get_type() == "STATUSTEXT":
                        self._take(message)
        return any(words in text for text in self.texts)

    def _take(self, message: Any) -> None:
        text = self._chunks.pop(message.id, "") + message.text
        if message.id and len(message.text) == 50:
            self._chunks[message.id] = text
        else:
            self.texts.append(text)


ENDS = [
    (CONTROL, signal.SIGKILL, 0.0, "control ended after", "signal 9, SIGKILL"),
    (CONTROL, signal.SIGSTOP, 0.6, "control is held up", "stopped by a signal"),
    (CONTROL, signal.SIGSTOP, 3.0, "control ended after", "it hung, signal 9, SIGKILL: stopped by"),
    (NAVIGATION, signal.SIGKILL, 0.0, "navigation ended after", "signal 9, SIGKILL"),
    (NAVIGATION, signal.SIGSTOP, 2.0, "navigation was held up for", "stopped by a signal"),
    (NAVIGATION, signal.SIGABRT, 0.0, "navigation ended after", "signal 6, SIGABRT"),
    (RECORDER, signal.SIGKILL, 0.0, "recorder ended after", "signal 9, SIGKILL"),
    (TELEMETRY, signal.SIGSTOP, 2.0, "telemetry was held up for", "stopped by a signal"),
    (TELEMETRY, signal.SIGKILL, 0.0, "telemetry ended after", "signal 9, SIGKILL"),
]
"""Which process, the signal, how long until SIGCONT [s], and parts of what is to be said."""


def logged(record: Path) -> list[str]:
    """Return all lines in the logs of states of a record."""
    lines = []
    for path in record.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                if channel.topic == "notice":
                    lines.append(json.loads(message.data)["message"])
    return lines


def test_every_end_and_every_pause_reaches_terminal_ground_station_log_and_exit_log(
    channel: str, ear: Ear, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    record = tmp_path / "record"
    notify = tmp_path_factory.mktemp("manager") / "notify"
    run = Run(channel, record, notify, f"udpin:127.0.0.1:{port}")
    station = Station(port)
    try:
        wait(lambda: (run.told(), run.said("ready: control"))[1], "the robot is ready")
        for module, number, pause_s, what, why in ENDS:
            wait(lambda: all_run(run), "all processes run")
            run.output, station.texts = "", []
            pid = run.child(module)
            os.kill(pid, number)
            if pause_s:
                time.sleep(pause_s)  # the pause is what is tested
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
            wait(lambda what=what: run.said(what), f"the terminal says {what}")
            wait(lambda what=what: station.heard(what), f"the ground station hears {what}")
            for lines in (run.output.splitlines(), station.texts):
                assert any(what in line and why in line for line in lines), (what, why, lines)
        run.output, station.texts = "", []
        os.kill(run.process.pid, signal.SIGSTOP)
        time.sleep(2.0)
        os.kill(run.process.pid, signal.SIGCONT)
        own = "the supervisor was held up for"
        wait(lambda: run.said(own), "the terminal says it")
        wait(lambda: station.heard(own), "the ground station hears it")
        entries = [json.loads(line) for line in (record / "exits.jsonl").read_text().splitlines()]
        recorder = Path(f"/proc/{run.child(RECORDER)}")
        run.process.send_signal(signal.SIGKILL)
        gone = "the supervisor ended: so does robotctl"
        wait(lambda: station.heard(gone), "the ground station hears of the supervisor's end")
        wait(lambda: not recorder.exists(), "the logs are closed")
    finally:
        run.process.kill()
        run.process.wait(DEADLINE_S)
        os.close(run.terminal)
        run.manager.close()
        station.socket.close()
    lines = logged(record)
    for module, _, pause_s, what, why in ENDS:
        assert any(what in line and why in line for line in lines), (what, why, lines)
        name = module.rpartition(".")[2]
        assert any(
            each["name"] == name and ("paused_s" in each) == ("held up" in what) for each in entries
        ), (name, pause_s, entries)
    assert any(own in line for line in lines)
    assert any(each["name"] == "the supervisor" for each in entries)


def all_run(run: Run) -> bool:
    """Return whether all processes work: of one that starts no pause is said."""
    run.told()
    return run.status.count(" running") == len(ROLES)
