"""The topics of the log live, over Foxglove's WebSocket, read-only.

Its protocol: https://github.com/foxglove/ws-protocol. Foxglove's SDK, an extra,
serves it in its own threads; nothing is encoded without a subscriber.
"""

from __future__ import annotations

import importlib.util
from collections import deque
from typing import TYPE_CHECKING, Any, Final

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding

from robotctl.errors import ConfigError, LinkError
from robotctl.logs.mcap.entries import TOPICS, Entry, LogEntries, Published
from robotctl.logs.mcap.log import schema_data
from robotctl.logs.mcap.scene import Scene

if TYPE_CHECKING:
    import foxglove
    from foxglove.websocket import WebSocketServer

PORT: Final = 8765
"""Default port of viewers; if taken, the next free one is used."""
PORTS: Final = 20
BACKLOG: Final = 64
"""Maximum messages kept for a slow viewer; older ones are dropped."""


def check_sdk() -> None:
    """Refuse to serve without the SDK.

    Raises
    ------
    ConfigError
        If it is not installed.
    """
    if importlib.util.find_spec("foxglove") is None:
        raise ConfigError(
            "web.foxglove is true, for which foxglove-sdk is needed, and it is not installed: "
            "install robotctl[foxglove], or set it to false"
        )


class LiveTopics:
    """Serves published messages to viewers, each topic to its subscribers.

    A viewer gets the newest message of a topic when it subscribes, so that a rare one, such as a
    map or an outline, is there at once.

    Parameters
    ----------
    host
        Listening address.
    epoch_ns
        Added to the stamps of messages to get wall time [ns].
    name
        Name of the robot.
    scene
        Frames and maps of the robot.

    Attributes
    ----------
    port
        Port in use.

    Raises
    ------
    LinkError
        If there is no free port.
    """

    def __init__(self, host: str, epoch_ns: int, name: str, scene: Scene) -> None:
        import foxglove  # noqa: PLC0415 - an extra

        self._context = context = foxglove.Context()  # ends with the last reference to it
        self._channels = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(
                    name=kind, encoding=SchemaEncoding.JSONSchema, data=schema_data(kind, schema)
                ),
                message_encoding=MessageEncoding.JSON,
                context=context,
            )
            for topic, (kind, schema) in TOPICS.items()
        }
        self._entries = LogEntries(epoch_ns, name, scene)
        self._encode = msgspec.json.Encoder().encode
        self._newest: dict[str, Entry] = {}
        self._viewers = _Viewers()
        self._server = _started(host, name, context, self._viewers)
        self.port = self._server.port

    @property
    def is_watched(self) -> bool:
        """Whether any topic has a subscriber."""
        return any(channel.has_sinks() for channel in self._channels.values())

    def show(self, message: Published) -> None:
        """Send a message to its subscribers."""
        for entry in self._entries.of(message):
            self._newest[entry[0]] = entry
            self._send(entry)

    def greet(self) -> None:
        """Send the newest messages to new subscribers since the last call."""
        for topic in self._viewers.take():
            if topic in self._newest:
                self._send(self._newest[topic])

    def _send(self, entry: Entry) -> None:
        topic, wall_ns, make = entry
        channel = self._channels[topic]
        if channel.has_sinks():
            channel.log(self._encode(make()), log_time=wall_ns)

    def close(self) -> None:
        """End all connections."""
        self._server.stop()


class _Viewers:
    """`ServerListener` that notes subscriptions; called by threads of the SDK."""

    def __init__(self) -> None:
        self._subscribed: deque[str] = deque(maxlen=1000)

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
        """Note the topic of a subscription."""
        self._subscribed.append(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing: the channel tracks its subscribers."""

    def take(self) -> list[str]:
        """Return the topics of the subscriptions since the last call."""
        return [self._subscribed.popleft() for _ in range(len(self._subscribed))]


def _started(host: str, name: str, context: foxglove.Context, viewers: _Viewers) -> WebSocketServer:
    """Return a server at the first free port, which takes no messages, calls or parameters."""
    import foxglove  # noqa: PLC0415 - an extra

    why = ""
    for port in range(PORT, PORT + PORTS):
        try:
            return foxglove.start_server(
                name=name,
                host=host,
                port=port,
                capabilities=[],
                server_listener=viewers,  # type: ignore[arg-type]
                context=context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            why = str(error)
    raise LinkError(f"Foxglove: not at {host}, ports {PORT} to {PORT + PORTS - 1}: {why}")
