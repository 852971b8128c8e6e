"""Foxglove's WebSocket: what a foreign client of its protocol receives, and may not send."""

import asyncio
import json
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from typing import Any

import jsonschema
import msgspec
import pytest
import websockets
from robo_ws_bridge import WebSocketBridgeClient

from robotctl.errors import ConfigError, LinkError
from robotctl.logs.mcap import live
from robotctl.logs.mcap.entries import TOPICS, LogEntries
from robotctl.logs.mcap.live import LiveTopics, check_sdk
from robotctl.logs.mcap.scene import Scene
from robotctl.messages.estimation import GivenMap, LiveMap
from robotctl.model.footprint import Footprint
from robotctl.web.config import WebConfig
from tests.mavlink.conftest import CONTROL, NAVIGATION

EPOCH_NS = 1_700_000_000_000_000_000
PROTOCOL = "foxglove.sdk.v1"
GIVEN = GivenMap(5, LiveMap(5, 2, 3, 0.05, -1.0, -2.0, bytes([0, 100, 255, 50, 0, 255])))


def scene() -> Scene:
    return Scene(bodies=(Footprint.rectangle(-0.2, 0.2, 0.1),))


@pytest.fixture
def topics() -> Iterator[LiveTopics]:
    served = LiveTopics("127.0.0.1", EPOCH_NS, "rover", scene())
    yield served
    served.close()


async def until(condition: Callable[[], Any], step: Callable[[], Any] = lambda: None) -> None:
    """Let the server step until a condition holds."""
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        step()
        await asyncio.sleep(0.005)


class Viewer:
    """A foreign client, and what came to it: time and content by topic."""

    def __init__(self, port: int) -> None:
        self.client = WebSocketBridgeClient(f"ws://127.0.0.1:{port}", subprotocol=PROTOCOL)
        self.received: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        self.client.on_message(self._take)

    async def _take(self, channel: dict[str, Any], timestamp: int, data: bytes) -> None:
        self.received[channel["topic"]].append((timestamp, json.loads(data)))

    @property
    def channels(self) -> dict[str, Any]:
        return {each["topic"]: each for each in self.client.channels.values()}


@asynccontextmanager
async def viewer(port: int) -> AsyncIterator[Viewer]:
    seen = Viewer(port)
    await seen.client.connect()
    try:
        await until(lambda: len(seen.channels) == len(TOPICS))
        yield seen
    finally:
        await seen.client.disconnect()


def test_a_viewer_gets_what_a_log_would_hold_of_the_topics_it_wants(topics: LiveTopics) -> None:
    states = [msgspec.structs.replace(CONTROL, stamp_ns=each * 20_000_000) for each in range(10)]
    expected = [
        (wall_ns, json.loads(msgspec.json.encode(make())))
        for state in states
        for topic, wall_ns, make in LogEntries(EPOCH_NS, "rover", scene()).of(state)
        if topic == "control"
    ]

    async def watch() -> None:
        async with viewer(topics.port) as seen:
            await seen.client.subscribe("control")
            await until(lambda: topics.is_watched)
            topics.greet()
            for state in states:
                topics.show(state)
            await until(lambda: len(seen.received["control"]) == len(states))
            assert seen.received["control"] == expected
            assert set(seen.received) == {"control"}
            channel = seen.channels["control"]
            assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
            jsonschema.validate(expected[0][1], json.loads(channel["schema"]))
            assert channel["schemaName"] == "ControlState"

    asyncio.run(watch())


def test_who_comes_late_gets_the_newest_of_each_topic(topics: LiveTopics) -> None:
    for stamp_ns in (0, 20_000_000):
        topics.show(msgspec.structs.replace(CONTROL, stamp_ns=stamp_ns))
    topics.show(msgspec.structs.replace(NAVIGATION, goal=(1.0, 2.0)))
    topics.show(GIVEN)
    assert not topics.is_watched

    async def watch() -> None:
        async with viewer(topics.port) as seen:
            for topic in ("map", "outline", "goal", "control"):
                await seen.client.subscribe(topic)
            await until(lambda: len(seen.received) == 4, topics.greet)
            assert {topic: len(each) for topic, each in seen.received.items()} == dict.fromkeys(
                ("map", "outline", "goal", "control"), 1
            )
            assert seen.received["map"][0][1]["column_count"] == 3
            assert seen.received["control"][0][0] == EPOCH_NS + 20_000_000
        await until(lambda: not topics.is_watched)

    asyncio.run(watch())


def test_nothing_is_made_of_a_topic_that_nobody_wants(topics: LiveTopics) -> None:
    made = []
    original = topics._encode
    topics._encode = lambda content: made.append(content) or original(content)

    async def watch() -> None:
        topics.show(CONTROL)
        async with viewer(topics.port) as seen:
            topics.show(CONTROL)
            assert made == []
            await seen.client.subscribe("navigation")
            await until(lambda: topics.is_watched)
            topics.show(msgspec.structs.replace(CONTROL, stamp_ns=1))
            assert made == []
            topics.show(NAVIGATION)
            await until(lambda: seen.received["navigation"])
            assert len(made) == 1

    asyncio.run(watch())


def test_nothing_comes_in(topics: LiveTopics) -> None:
    async def ask() -> None:
        url = f"ws://127.0.0.1:{topics.port}"
        async with websockets.connect(url, subprotocols=[PROTOCOL]) as socket:
            info = json.loads(await socket.recv())
            assert (info["op"], info["name"], info["capabilities"]) == ("serverInfo", "rover", [])
            assert json.loads(await socket.recv())["op"] == "advertise"
            channel = {"id": 1, "topic": "cmd", "encoding": "json", "schemaName": "x"}
            for request in (
                {"op": "advertise", "channels": [channel]},
                {"op": "getParameters", "parameterNames": [], "id": "1"},
                {"op": "setParameters", "parameters": [{"name": "a", "value": 1}]},
            ):
                await socket.send(json.dumps(request))
                answer = json.loads(await socket.recv())
                assert answer["op"] == "status"
                assert "does not support" in answer["message"]

    asyncio.run(asyncio.wait_for(ask(), 20.0))


def test_where_the_port_is_taken_it_is_the_next(
    topics: LiveTopics, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "PORT", topics.port)  # earlier ones come and go with other programs
    second = LiveTopics("127.0.0.1", EPOCH_NS, "other", scene())
    assert second.port > topics.port
    monkeypatch.setattr(live, "PORTS", 1)
    with pytest.raises(LinkError, match=f"not at 127.0.0.1, ports {topics.port}"):
        LiveTopics("127.0.0.1", EPOCH_NS, "third", scene())
    second.close()


def test_a_missing_sdk_is_told_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    check_sdk()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"install robotctl\[foxglove\], or set it to false$"):
        check_sdk()


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "::"])
def test_it_is_refused_where_others_reach_it(host: str) -> None:
    with pytest.raises(ValueError, match=r"has no token.* ssh -L 8765:127\.0\.0\.1:8765"):
        WebConfig(host=host, foxglove=True)
    for loopback in ("127.0.0.1", "localhost", "::1"):
        assert WebConfig(host=loopback, foxglove=True).is_loopback
