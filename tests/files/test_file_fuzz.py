"""Changed files of all kinds: readers raise nothing but what commands turn into sentences."""

import struct
import tracemalloc

import pytest

from robotctl.errors import RobotctlError
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.mcap.recovery import recover
from robotctl.maps.map_file import load_map
from tests.files import fuzzing
from tests.files.fuzzing import TARGETS, YAML, corpus

FILES = {"mcap": 4, "recover": 1, "pgm": 3, "robot": 2, "world": 2, "mission": 2}
"""How many valid files a target changes, where not one; `recover` leaves whole ones alone."""


@pytest.mark.parametrize("target", TARGETS)
def test_what_fuzzing_has_found_upsets_nothing(target):
    """Inputs that `tools/fuzz.py` has kept: between them they reach what it has reached."""
    inputs = corpus(target)
    assert len(inputs) > 5
    for data in inputs:
        TARGETS[target](data)


@pytest.mark.parametrize("target", TARGETS)
def test_without_a_change_the_files_are_read(target, monkeypatch):
    """Else nothing behind the first check would ever be tried."""
    monkeypatch.setattr(fuzzing, "attempt", lambda read: read())
    for file in range(FILES.get(target, 1)):
        TARGETS[target](bytes([file]))


HUGE = 1 << 60


def chunk(data_length):
    """An MCAP file whose chunk tells of a length that no disk has."""
    heading = struct.pack("<BQI4sI", 1, 12, 4, b"ros2", 0)
    fields = struct.pack("<QQQII", 0, 0, HUGE, 0, 0)
    length = len(fields) + 8 + data_length
    return (
        b"\x89MCAP0\r\n" + heading + struct.pack("<BQ", 6, length) + fields
        + struct.pack("<Q", data_length) + bytes(50)
    )  # fmt: skip


@pytest.fixture
def little_memory():
    """Assert that a test asks for no more memory than its file has reason for."""
    tracemalloc.start()
    yield
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 50_000_000


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("read", [read_recording, recover])
@pytest.mark.parametrize("length", [HUGE, (1 << 63) - 100, 1 << 27])
def test_lengths_in_an_mcap_file_that_no_disk_has_ask_for_no_memory(tmp_path, read, length):
    path = tmp_path / "drive.mcap"
    path.write_bytes(chunk(length))
    with pytest.raises(RobotctlError, match=r"drive\.mcap: "):
        read(path)
    assert path.read_bytes() == chunk(length)


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("kind", [b"P5", b"P2", b"P6"])
@pytest.mark.parametrize("side", [b"99999999", b"4294967295", b"9" * 30])
def test_an_image_of_a_map_that_claims_to_be_huge_is_a_sentence(tmp_path, kind, side):
    (tmp_path / "room.pgm").write_bytes(kind + b"\n" + side + b" " + side + b"\n255\n" + bytes(100))
    (tmp_path / "room.yaml").write_bytes(YAML)
    with pytest.raises(RobotctlError, match=r"room\.pgm"):
        load_map(tmp_path / "room.yaml")


def test_a_message_of_many_ranges_that_are_not_there_is_damage(tmp_path):
    content = fuzzing.small_bag("ros1")
    count = content.index(struct.pack("<8f", *[2.0] * 8)) - 4
    path = tmp_path / "drive.bag"
    path.write_bytes(content[:count] + struct.pack("<I", 0xFFFFFFFF) + content[count + 4 :])
    with pytest.raises(LogFormatError, match=r"drive\.bag: the bag is damaged or incomplete"):
        read_recording(path)
