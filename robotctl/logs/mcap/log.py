"""The continuous log: the processes' messages, as MCAP with JSON.

docs/logs.md lists its topics. A chunk ends at each `flush`, so that a file cut anywhere holds all
that came before its last flush. Such a file has no index: strict readers want it recovered first.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import BinaryIO, Final

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

import robotctl
from robotctl.logs.mcap.entries import TOPICS, Entry, LogEntries, Published
from robotctl.logs.mcap.scene import Scene
from robotctl.logs.mcap.schema import JsonSchema

LIBRARY: Final = f"robotctl {robotctl.__version__}"
"""Name of the writer in the heading of each of our logs."""


def schema_data(name: str, schema: JsonSchema) -> bytes:
    """Return a schema as encoded in files and by servers."""
    return msgspec.json.encode({"title": name, **schema})


class McapLog:
    """Writes published messages to an MCAP file, and the frames that a viewer needs to show them.

    Parameters
    ----------
    file
        Empty file open for writing in binary mode; left open by `close`.
    epoch_ns
        Added to the stamps of messages to get wall time [ns].
    name
        Name of the robot.
    scene
        Common data of all files of a run; None: unknown robot.
    """

    def __init__(
        self, file: BinaryIO, epoch_ns: int, name: str, scene: Scene | None = None
    ) -> None:
        self._writer = Writer(file)
        self._writer.start(library=LIBRARY)
        self._encode = msgspec.json.Encoder().encode
        self._entries = LogEntries(epoch_ns, name, scene or Scene())
        self._schemas: dict[str, int] = {}
        self._channels = {topic: self._channel(topic, *known) for topic, known in TOPICS.items()}

    def _channel(self, topic: str, name: str, schema: JsonSchema) -> int:
        """Register a topic with the name of its schema."""
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(
                name, SchemaEncoding.JSONSchema, schema_data(name, schema)
            )
        return self._writer.register_channel(topic, MessageEncoding.JSON, self._schemas[name])

    def add(self, message: Published) -> None:
        """Add a message at its stamp."""
        self._write(self._entries.of(message))

    def _write(self, entries: Iterable[Entry]) -> None:
        """Write entries."""
        for topic, wall_ns, make in entries:
            self._writer.add_message(self._channels[topic], wall_ns, self._encode(make()), wall_ns)

    def flush(self) -> None:
        """Pass everything so far to the kernel, where it survives a kill."""
        self._writer.flush()

    def close(self) -> None:
        """Complete the file with the newest maps and the index."""
        self._write(self._entries.newest_maps())
        self._writer.finish()
