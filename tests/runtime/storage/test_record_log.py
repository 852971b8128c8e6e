"""Logs of records: whatever is killed or cut, all whole records come back; damage is told."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.runtime.storage.record_log import (
    DamagedLogError,
    RecordLog,
    packed,
    read_records,
    set_aside,
    unpacked,
)

HEADING = b"robotctl-test 1\n"
RECORDS = [b"first", b"", b"third " * 20, bytes(40), b"last"]


def last_of(records):
    return records[-1:]


def ends():
    """Where each record of a file ends."""
    return [len(HEADING) + len(packed(RECORDS[:count])) for count in range(len(RECORDS) + 1)]


def test_a_file_cut_at_any_byte_has_all_records_that_are_whole(tmp_path):
    content, path = HEADING + packed(RECORDS), tmp_path / "log"
    for size in range(len(content) + 1):
        path.write_bytes(content[:size])
        whole = sum(end <= size for end in ends()[1:])
        assert read_records(path, HEADING) == RECORDS[:whole]


@pytest.mark.parametrize("zeros", [1, 11, 12, 4096])
def test_what_a_power_cut_leaves_unwritten_is_left_out(tmp_path, zeros):
    path = tmp_path / "log"
    path.write_bytes(HEADING + packed(RECORDS) + bytes(zeros))
    assert read_records(path, HEADING) == RECORDS


@given(st.data())
def test_a_changed_byte_is_never_read_as_something_else(data):
    content = packed(RECORDS)
    at = data.draw(st.integers(0, len(content) - 1))
    changed = bytearray(content)
    changed[at] ^= data.draw(st.integers(1, 255))
    found = RECORDS[:-1]
    with contextlib.suppress(ValueError):
        found = unpacked(bytes(changed))
    assert found == RECORDS[:-1]


def test_a_writer_goes_on_after_what_was_read(tmp_path):
    path = tmp_path / "of" / "log"
    log = RecordLog(path, HEADING, [b"before"], last_of)
    log.add([b"a", b"b"])
    log.add([b"c"])
    log.close()
    assert read_records(path, HEADING) == [b"before", b"a", b"b", b"c"]
    log = RecordLog(path, HEADING, last_of(read_records(path, HEADING)), last_of)
    with pytest.raises(Exception, match="another process writes it"):
        RecordLog(path, HEADING, [], last_of)
    log.close()
    assert read_records(path, HEADING) == [b"c"]


def test_a_file_that_has_become_long_is_compacted(tmp_path):
    path, megabyte = tmp_path / "log", bytes(1 << 20)
    log = RecordLog(path, HEADING, [], last_of)
    for number in range(20):
        log.add([bytes([number]) + megabyte])
    log.close()
    # Compacted to one once it had grown by 16 MiB; the writer may come to the last four after it.
    assert path.stat().st_size <= len(HEADING) + 5 * len(packed([bytes(1) + megabyte]))
    assert read_records(path, HEADING)[-1] == bytes([19]) + megabyte


def test_other_files_are_damaged_and_set_aside(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"something else")
    with pytest.raises(DamagedLogError, match="does not begin with"):
        read_records(path, HEADING)
    assert set_aside(path).read_bytes() == b"something else"
    assert read_records(path, HEADING) == []
