"""Merging of several logs of a run: every readable message, in the order of the files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Message, Schema
from mcap.writer import Writer

from robotctl.logs.mcap.log import LIBRARY
from robotctl.logs.mcap.records import Gap
from robotctl.logs.mcap.recovery import log_records


def merge(files: Sequence[Path], target: BinaryIO, notes: list[str]) -> int:
    """Write the messages of logs into one, unchanged; return their number.

    Topics of the same name and schema become one. Sentences on what cannot be read are added to
    `notes`.

    Raises
    ------
    OSError
        If a file cannot be read or written.
    """
    writer = Writer(target)
    writer.start(library=f"{LIBRARY}, exported")
    merged = _Merged(writer)
    for file in files:
        merged.add(file, notes)
    writer.finish()
    return merged.messages


class _Merged:
    """The merged log, with its schemas and channels by content."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[tuple[str, str, int], int] = {}
        self.messages = 0

    def add(self, file: Path, notes: list[str]) -> None:
        """Add the messages of a file."""
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        with file.open("rb") as source:
            for record in log_records(source):
                if isinstance(record, Schema):
                    schemas[record.id] = self._schema(record)
                elif isinstance(record, Channel):
                    channels[record.id] = self._channel(record, schemas.get(record.schema_id, 0))
                elif isinstance(record, Message) and record.channel_id in channels:
                    self.messages += 1
                    self._writer.add_message(
                        channels[record.channel_id],
                        record.log_time,
                        record.data,
                        record.publish_time,
                        record.sequence,
                    )
                elif isinstance(record, Gap) and record.lost:
                    notes.append(f"{file}: {record.lost} bytes at byte {record.begin} are damaged")

    def _schema(self, record: Schema) -> int:
        key = (record.name, record.encoding, record.data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]

    def _channel(self, record: Channel, schema: int) -> int:
        key = (record.topic, record.message_encoding, schema)
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(*key, record.metadata)
        return self._channels[key]
