"""Logs cut within a chunk: what stands whole in it is kept, and the original whatever happens."""

import errno
import io
import json
import os
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.robotctl_log import json_messages
from robotctl.logs.mcap import recovery
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.recovery import McapLogError, recover
from robotctl.messages.control import Notice
from tests.cli.command import status_of
from tests.logs.formats.bags import write_bag
from tests.logs.mcap.test_recovery import recovered_or_none

TEXTS = [f"{number}: {os.urandom(500).hex()}" for number in range(400)]
"""Of 1000 random letters each, so that a chunk has many blocks of zstd (128 kB) and lz4 (64 kB)."""


def foreign_log(compression: CompressionType) -> bytes:
    """Return a log with one chunk, of the library that all programs but ours use."""
    file = io.BytesIO()
    writer = Writer(file, compression=compression, chunk_size=1 << 24)
    writer.start(profile="text", library="somebody")
    words = writer.register_channel("/words", "json", 0)
    for number, text in enumerate(TEXTS):
        writer.add_message(words, number, json.dumps({"message": text}).encode(), number)
    writer.finish()
    return file.getvalue()


def own_log() -> bytes:
    file = io.BytesIO()
    log = McapLog(file, 0, "rover")
    for number, text in enumerate(TEXTS):
        log.add(Notice(number, 6, text))
    log.close()
    return file.getvalue()


LOGS = {each.name: foreign_log(each) for each in CompressionType} | {"ours": own_log()}
BLOCK = {"NONE": 0, "LZ4": 1 << 16, "ZSTD": 1 << 17, "ours": 1 << 17}


def texts_in(content: bytes) -> list[str]:
    reader = make_reader(io.BytesIO(content), validate_crcs=True)
    return [json.loads(message.data)["message"] for *_, message in reader.iter_messages()]


@pytest.mark.parametrize("kind", LOGS)
@given(share=st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_whole_messages_of_the_only_chunk_are_kept_and_the_rest_is_told(
    tmp_path_factory: pytest.TempPathFactory, kind: str, share: float
) -> None:
    content = LOGS[kind]
    summary = make_reader(io.BytesIO(content)).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[0]
    begin = chunk.chunk_start_offset
    cut = begin + int(share * (chunk.chunk_length - 1))
    path = tmp_path_factory.mktemp("log") / "drive.mcap"
    path.write_bytes(content[:cut])
    sizes = [
        len(message.data) + 31 for *_, message in make_reader(io.BytesIO(content)).iter_messages()
    ]
    heading = chunk.uncompressed_size - sum(sizes)  # schemas and channels
    # A compressed block takes at most its own length, and the message across its end is lost.
    least = int((share * chunk.uncompressed_size - BLOCK[kind] - heading) / max(sizes)) - 1
    recovered = recovered_or_none(path)
    if recovered is None:
        assert least <= 0
        assert path.read_bytes() == content[:cut]
        assert list(path.parent.iterdir()) == [path]
        return
    kept = texts_in(path.read_bytes())
    assert kept == TEXTS[: len(kept)]
    assert recovered.messages == len(kept) >= least
    assert recovered.kept_aside is not None
    assert recovered.kept_aside.read_bytes() == content[:cut]
    (gap,) = recovered.gaps
    whole = sum(map(len, kept))
    assert (
        chunk.uncompressed_size - 1.5 * whole - 3000 < gap.lost <= chunk.uncompressed_size - whole
    )
    assert f"; left out the cut end, {gap.lost} bytes of data; as it was: " in recovered.loss()


def test_every_message_of_an_uncompressed_chunk_that_stands_whole_is_kept(tmp_path: Path) -> None:
    content, path = LOGS["NONE"], tmp_path / "drive.mcap"
    for number in (0, 1, 57, 399):
        end = content.index(TEXTS[number].encode()) + len(TEXTS[number]) + len('"}')
        for cut, kept in ((end, number + 1), (end - 1, number)):
            path.write_bytes(content[:cut])
            if kept == 0:
                with pytest.raises(McapLogError, match="no message in it can be recovered"):
                    recover(path)
            else:
                assert recover(path).messages == kept
                assert texts_in(path.read_bytes()) == TEXTS[:kept]


def test_zeros_that_a_power_cut_leaves_in_a_chunk_are_no_messages(tmp_path: Path) -> None:
    content, path = LOGS["NONE"], tmp_path / "drive.mcap"
    middle = content.index(TEXTS[100].encode()) + 20
    path.write_bytes(content[:middle] + bytes(5000))
    assert recover(path).messages == 100


def test_a_cut_log_of_ours_is_read_as_far(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(LOGS["ours"][: len(LOGS["ours"]) * 6 // 10])
    notes: list[str] = []
    found = [json.loads(message.data)["message"] for _, message in json_messages(path, notes)]
    assert found == TEXTS[: len(found)]
    assert len(found) > 100
    assert notes == [f"{path}: was cut short, read up to there"]


def test_profile_library_metadata_and_attachments_go_with_the_messages(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="libmcap 1.2")
        writer.add_metadata("rosbag2", {"ROS_DISTRO": "jazzy"})
        writer.add_attachment(1, 2, "lens.yaml", "text/yaml", b"k1: 0.1")
        channel = writer.register_channel("/words", "json", 0, {"offered_qos_profiles": ""})
        writer.add_message(channel, 3, b'{"message": "a"}', 4, 5)
        writer.flush()
    recover(path)
    with path.open("rb") as file:
        reader = make_reader(file)
        header = reader.get_header()
        assert (header.profile, header.library) == ("ros2", "libmcap 1.2, recovered")
        assert [each.metadata for each in reader.iter_metadata()] == [{"ROS_DISTRO": "jazzy"}]
        assert [each.data for each in reader.iter_attachments()] == [b"k1: 0.1"]
        ((_, channel, message),) = reader.iter_messages()
        assert channel.metadata == {"offered_qos_profiles": ""}
        assert (message.log_time, message.publish_time, message.sequence) == (3, 4, 5)


def test_a_cut_ros_2_bag_is_a_drive_again(tmp_path: Path) -> None:
    write_bag(tmp_path / "drive", "mcap")
    (bag,) = (tmp_path / "drive").glob("*.mcap")
    path = tmp_path / "cut.mcap"
    path.write_bytes(bag.read_bytes()[: bag.stat().st_size * 8 // 10])
    assert status_of("record", "recover", path) == 0
    assert 0 < len(read_recording(path).scans) < 60


@pytest.mark.parametrize("content", [b"", b"\x01\x10\0\0\0\0\0\0\0\4\0\0\0ros2\4\0\0\0some"])
def test_a_log_without_a_message_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    path = tmp_path / "drive.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + content)
    before = path.read_bytes()
    assert status_of("record", "recover", path) == 2
    words = capsys.readouterr().err
    assert f"{path}: no message in it can be recovered" in words
    assert "; left as it is" in words
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    path = tmp_path / "drive.mcap"
    path.write_bytes(LOGS["NONE"][: len(LOGS["NONE"]) // 2])
    return path


def test_a_log_is_replaced_only_after_the_new_one_was_read_back(
    cut: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that drops a write without an error."""

    class Forgetful(Writer):
        def add_message(self, *args: object) -> None:
            if args[1] != 7:
                super().add_message(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(recovery, "Writer", Forgetful)
    before = cut.read_bytes()
    with pytest.raises(McapLogError, match=r"reads back with 202 of 203 messages"):
        recover(cut)
    assert cut.read_bytes() == before
    assert list(cut.parent.iterdir()) == [cut]


def test_a_full_disk_changes_nothing(
    cut: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    before = cut.read_bytes()
    assert status_of("record", "recover", cut) == 2
    assert f"{cut}: cannot be recovered: No space left on device" in capsys.readouterr().err
    assert cut.read_bytes() == before
    assert list(cut.parent.iterdir()) == [cut]


def killed_at(event: int, path: Path) -> bool:
    """Recover a log in a process that is killed at an event of the file system; return whether."""
    child = os.fork()
    if child == 0:
        left = event

        def count(name: str, _: object) -> None:
            nonlocal left
            if name in {"open", "os.rename", "os.link", "os.remove", "os.listdir", "os.scandir"}:
                left -= 1
                if left < 0:
                    os._exit(9)

        sys.addaudithook(count)
        try:
            recover(path)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


def test_a_kill_at_any_moment_loses_nothing(tmp_path: Path) -> None:
    content = LOGS["NONE"][: len(LOGS["NONE"]) // 2]
    for event in range(100):
        path = tmp_path / str(event) / "drive.mcap"
        path.parent.mkdir()
        path.write_bytes(content)
        was_killed = killed_at(event, path)
        assert content in [each.read_bytes() for each in path.parent.iterdir()]
        recovered = recover(path)
        kept = texts_in(path.read_bytes())
        assert kept == TEXTS[: len(kept)]
        assert len(kept) == recovered.messages > 150
        beside = [each for each in path.parent.iterdir() if each != path]
        assert [each.read_bytes() for each in beside] == [content]
        if not was_killed:
            break
    assert 5 < event < 99
