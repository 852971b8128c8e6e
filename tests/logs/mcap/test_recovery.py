"""Damaged MCAP logs: what is whole is kept, what is lost is said, no original is thrown away."""

import io
import json
import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from robotctl.logs.logs import recover_all
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.recovery import McapLogError, RecoveredLog, recover
from robotctl.messages.control import Notice
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder
from tests.cli.command import status_of

MAGIC = 8


@dataclass(frozen=True)
class Log:
    """A log that was closed, and what the reference library finds in each of its chunks."""

    content: bytes
    chunks: tuple[tuple[range, tuple[str, ...]], ...]
    indexes: tuple[int, ...]
    """Where the records between the chunks begin."""
    data_end: int

    def of_intact(self, damaged: Sequence[int], size: int) -> list[str]:
        """Return the messages of the chunks that have no damaged byte, in a file of this size."""
        return [
            text
            for place, texts in self.chunks
            if place.stop <= size and not any(at in place for at in damaged)
            for text in texts
        ]

    def of_readable(self, content: bytes) -> list[str]:
        """Return the messages of the chunks that the reference library reads, their CRC checked.

        A chunk says when its messages were, outside of its CRC: there a flipped bit is no loss.
        Its own length and that of its content must be what they were.
        """
        texts: list[str] = []
        for place, _ in self.chunks:
            now, then = (each[place.start : place.stop] for each in (content, self.content))
            if now[:9] != then[:9] or now[33:53] != then[33:53]:
                continue
            try:
                chunk = Chunk.read(ReadDataStream(io.BytesIO(now[9:])))
                assert chunk.uncompressed_size < 1 << 28
                records = breakup_chunk(chunk, validate_crc=True)
            except Exception:  # noqa: BLE001 - whatever it is, the library does not read it
                continue
            texts += [text_of(each) for each in records if isinstance(each, Message)]
        return texts


def text_of(message: Message) -> str:
    return str(json.loads(message.data)["message"])


def make_log() -> Log:
    file = io.BytesIO()
    log = McapLog(file, 0, "rover")
    for second in range(12):
        for tenth in range(10):
            log.add(Notice(second * 10**9 + tenth * 10**8, 6, f"{second}.{tenth}"))
        log.flush()
    log.close()
    content = file.getvalue()
    records = [
        each
        for each in StreamReader(io.BytesIO(content), emit_chunks=True).records
        if isinstance(each, Chunk)
    ]
    summary = make_reader(io.BytesIO(content)).get_summary()
    assert summary is not None
    chunks = tuple(
        (
            range(index.chunk_start_offset, index.chunk_start_offset + index.chunk_length),
            tuple(text_of(each) for each in breakup_chunk(chunk) if isinstance(each, Message)),
        )
        for index, chunk in zip(summary.chunk_indexes, records, strict=True)
    )
    assert len(chunks) == 12
    indexes = tuple(
        place for index in summary.chunk_indexes for place in index.message_index_offsets.values()
    )
    last = summary.chunk_indexes[-1]
    return Log(content, chunks, indexes, chunks[-1][0].stop + last.message_index_length)


LOG = make_log()
ALL = LOG.of_intact((), len(LOG.content))


def flipped(content: bytes, bits: Sequence[int]) -> bytes:
    damaged = bytearray(content)
    for bit in bits:
        damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def recovered_or_none(path: Path) -> RecoveredLog | None:
    """Recover a log; None if no message in it can be."""
    try:
        return recover(path)
    except McapLogError as error:
        if "no message in it can be recovered" not in str(error):
            raise
        return None


def texts_in(path: Path) -> list[str]:
    return [
        text_of(message)
        for *_, message in make_reader(io.BytesIO(path.read_bytes())).iter_messages()
    ]


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_whatever_bits_are_flipped_intact_chunks_are_kept_and_losses_said(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    size = data.draw(st.one_of(st.just(len(LOG.content)), st.integers(100, len(LOG.content))))
    places = st.integers(MAGIC * 8, size * 8 - 1)
    bits = data.draw(st.lists(places, min_size=1, max_size=4, unique=True))
    content = flipped(LOG.content[:size], bits)
    path = tmp_path_factory.mktemp("log") / "robot-0001.mcap"
    path.write_bytes(content)
    recovered = recovered_or_none(path)
    if recovered is None:
        # Without heading and definitions nobody knows whose log it is.
        first, readable = LOG.chunks[0], LOG.of_readable(content)
        has_heading = content.startswith(LOG.content[: first[0].start])
        assert readable == [] or not (has_heading or first[1][0] in readable)
        assert path.read_bytes() == content
        return
    kept = texts_in(path)
    assert len(kept) == recovered.messages
    assert kept == [text for text in ALL if text in set(kept)]
    intact = LOG.of_intact([bit // 8 for bit in bits], size)
    readable = LOG.of_readable(content)
    assert set(intact) <= set(readable)
    assert set(kept) <= set(readable)
    assert kept == readable
    # A flipped bit in what nobody needs loses nothing.
    was_whole = LOG.of_intact((), size)
    if not set(was_whole) <= set(kept):
        assert recovered.kept_aside is not None
    if recovered.kept_aside is not None:
        assert recovered.kept_aside.read_bytes() == content
        assert "; left out " in recovered.loss()
    else:
        assert recovered.loss() == ""


@pytest.mark.parametrize("number", range(12))
@pytest.mark.parametrize("part", ["opcode", "length", "checksum", "content"])
@pytest.mark.parametrize("is_closed", [True, False])
def test_a_damaged_chunk_costs_itself_and_no_other(
    tmp_path: Path, number: int, part: str, is_closed: bool
) -> None:
    place, lost = LOG.chunks[number]
    at = place.start + {"opcode": 0, "length": 2, "checksum": 34, "content": 80}[part]
    content = flipped(LOG.content if is_closed else LOG.content[: LOG.data_end], [8 * at])
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(content)
    recovered = recover(path)
    assert texts_in(path) == [text for text in ALL if text not in lost]
    (gap,) = recovered.gaps
    assert gap.begin == place.start
    assert gap.length >= len(place)
    assert recovered.kept_aside == tmp_path / "robot-0001.mcap.damaged-1"
    assert recovered.kept_aside.read_bytes() == content


@pytest.mark.parametrize("place", [MAGIC, *LOG.indexes])
@pytest.mark.parametrize("bit", range(8))
def test_no_flipped_kind_makes_a_message_of_another_record(
    tmp_path: Path, place: int, bit: int
) -> None:
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(flipped(LOG.content, [8 * place + bit]))
    recovered = recover(path)
    assert texts_in(path) == ALL
    assert recovered.unknown == 0


def test_zeros_that_a_power_cut_leaves_at_the_end_are_a_cut(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(LOG.content[: LOG.data_end] + bytes(4096))
    recovered = recover(path)
    assert (recovered.messages, recovered.kept_aside) == (120, None)


def test_messages_of_a_topic_whose_definition_is_lost_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library="somebody else")
        topic = writer.register_channel("words", "json", 0)
        for time_ns in range(3):
            writer.add_message(topic, time_ns, b"{}", time_ns)
            writer.flush()
        another = writer.register_channel("more words", "json", 0)
        for time_ns in range(3):
            writer.add_message(another, time_ns, b"{}", time_ns)
            writer.flush()
        writer.finish()
    place = path.read_bytes().index(b"zstd")
    path.write_bytes(flipped(path.read_bytes(), [8 * (place + 20)]))
    recovered = recover(path)
    assert (recovered.messages, recovered.unknown) == (3, 2)
    assert "and 2 messages of unknown topics" in recovered.loss()


def test_a_log_whose_only_definitions_are_lost_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library="somebody else")
        topic = writer.register_channel("words", "json", 0)
        for time_ns in range(3):
            writer.add_message(topic, time_ns, b"{}", time_ns)
            writer.flush()
        writer.finish()
    place = path.read_bytes().index(b"zstd")
    content = flipped(path.read_bytes(), [8 * (place + 20)])
    path.write_bytes(content)
    with pytest.raises(McapLogError, match="2 messages are of topics whose definitions are lost"):
        recover(path)
    assert path.read_bytes() == content


def test_the_completed_log_has_mode_and_owner_of_the_cut_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given_to = []
    monkeypatch.setattr(os, "fchown", lambda _, user, group: given_to.append((user, group)))
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(LOG.content[:-100])
    path.chmod(0o640)
    recover(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert given_to == [(path.stat().st_uid, path.stat().st_gid)]


def test_a_damaged_log_is_set_aside_by_the_recorder_and_by_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = flipped(LOG.content[: LOG.data_end], [8 * (LOG.chunks[3][0].start + 80)])
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(content)
    folder = LogFolder(tmp_path, LogConfig())
    (note,) = recover_all(folder)
    assert "was cut, completed with its 110 messages; left out 1 damaged place, " in note
    assert note.endswith(f"bytes; as it was: {path}.damaged-1")
    assert recover_all(folder) == ()
    path.write_bytes(content)
    assert status_of("record", "recover", path) == 0
    words = capsys.readouterr().out
    assert "complete, 110 messages; left out 1 damaged place, " in words
    assert words.endswith(f"as it was: {path}.damaged-2\n")


def test_damaged_logs_count_for_the_room_of_a_folder(tmp_path: Path) -> None:
    damaged = tmp_path / "robot-0001.mcap.damaged-1"
    damaged.write_bytes(bytes(2_000_000))
    LogFolder(tmp_path, LogConfig(file_mb=0.1, total_mb=1.0)).trim()
    assert not damaged.exists()


@pytest.mark.parametrize("library", ["robotctl", "another"])
def test_a_whole_log_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], library: str
) -> None:
    path = tmp_path / "robot-0001.mcap"
    with path.open("wb") as file:
        if library == "robotctl":
            log = McapLog(file, 0, "rover")
            for number in range(10):
                log.add(Notice(number, 6, str(number)))
            log.close()
        else:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/words", "text", 0)
            for number in range(10):
                writer.add_message(channel, number, b"word", number)
            writer.finish()
    before, status = path.read_bytes(), path.stat()
    assert status_of("record", "recover", path) == 0
    assert capsys.readouterr().out == f"{path}: is complete, 10 messages; left as it is\n"
    after = path.stat()
    assert path.read_bytes() == before
    assert (after.st_ino, after.st_mtime_ns) == (status.st_ino, status.st_mtime_ns)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_whole_log_with_a_damaged_index_is_completed(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    content = make_log().content
    with io.BytesIO(content) as file:
        begin = make_reader(file).get_summary()
    assert begin is not None
    damaged = bytearray(content)
    damaged[-60] ^= 0xFF  # in the summary, before footer and magic
    path.write_bytes(bytes(damaged))
    recover(path)
    assert path.read_bytes() != bytes(damaged)
    with path.open("rb") as whole:
        assert make_reader(whole, validate_crcs=True).get_summary() is not None
