"""The Foxglove process: what the robot publishes reaches a viewer, and its end is orderly."""

import asyncio
import json
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest
import websockets
import zmq

from robotctl.app.supervision.stack import FOXGLOVE, Stack
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.messages.control import Notice
from robotctl.runtime.ipc.topics import Endpoints, Publisher, Subscriber, endpoint_directory
from tests.mavlink.conftest import CONTROL

DEADLINE_S = 40.0
ROBOT = str(find_file("diff_drive").resolve())


def options_of(*overrides: str) -> StackOptions:
    return StackOptions("robot", ROBOT, overrides, run="test", epoch_ns=1_000_000_000)


async def first_states(url: str, publisher: Publisher) -> list[tuple[int, dict[str, Any]]]:
    """Return times and contents of the first two states that a viewer gets."""
    async with websockets.connect(url, subprotocols=["foxglove.sdk.v1"]) as socket:
        await socket.recv()
        channels = json.loads(await socket.recv())["channels"]
        (control,) = (each["id"] for each in channels if each["topic"] == "control")
        wanted = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": control}]}
        await socket.send(json.dumps(wanted))
        found: list[tuple[int, dict[str, Any]]] = []
        stamp_ns = 0
        while len(found) < 2:
            stamp_ns += 20_000_000
            publisher.send(msgspec.structs.replace(CONTROL, stamp_ns=stamp_ns))
            try:
                data = await asyncio.wait_for(socket.recv(), 0.05)
            except TimeoutError:
                continue
            assert isinstance(data, bytes)
            found.append((int.from_bytes(data[5:13], "little"), json.loads(data[13:])))
        return found


def test_a_viewer_gets_the_states_of_the_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    options = options_of("web.foxglove=true")
    endpoints = Endpoints(endpoint_directory(options.instance))
    context: zmq.Context[Any] = zmq.Context()
    publisher = Publisher(context, endpoints.control_state)
    notices = Subscriber[Notice](context, (endpoints.foxglove_notices,), Notice)
    with subprocess.Popen(options.command(FOXGLOVE)) as process:
        try:
            told: list[Notice] = []
            deadline_s = time.monotonic() + DEADLINE_S
            while not told:
                assert time.monotonic() < deadline_s, "the process is there"
                time.sleep(0.02)
                told = notices.receive()
            url = told[0].text.removeprefix("Foxglove: ")
            states = asyncio.run(asyncio.wait_for(first_states(url, publisher), DEADLINE_S))
            for time_ns, state in states:
                assert time_ns == state["stamp_ns"] + options.epoch_ns
                assert state["T_odom_base"]["x_m"] == CONTROL.x_m
            process.send_signal(signal.SIGTERM)
            assert process.wait(DEADLINE_S) == 0
        finally:
            process.kill()
            context.destroy(linger=0)


def test_a_robot_without_the_sdk_says_so_before_it_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match="foxglove-sdk is needed"):
        Stack(options_of("web.foxglove=true"))
