"""Stored parameters survive a power cycle, and a damaged file is never believed."""

from __future__ import annotations

import json
import os
import stat

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.nodes.parameter_store import FileStore, MemoryStore, StoreDamagedError

VALUES = {(0x2000, 0): 80, (0x1801, 2): 2}


@pytest.fixture(params=["memory", "file"])
def store(request, tmp_path):
    return MemoryStore() if request.param == "memory" else FileStore(tmp_path / "state", "drive")


def test_an_empty_store_has_nothing(store):
    assert store.load() == {}
    store.clear()
    assert store.load() == {}


def test_what_is_saved_is_loaded_until_cleared(store):
    store.save(VALUES)
    store.save({**VALUES, (0x2000, 0): 90})
    assert store.load() == {**VALUES, (0x2000, 0): 90}
    store.clear()
    assert store.load() == {}


def test_the_directory_is_private_and_holds_one_file(tmp_path):
    store = FileStore(tmp_path / "state", "drive")
    store.save(VALUES)
    store.save(VALUES)
    assert stat.S_IMODE((tmp_path / "state").stat().st_mode) == 0o700
    assert [each.name for each in (tmp_path / "state").iterdir()] == ["drive.json"]


@given(place=st.integers(0, 10_000), value=st.integers(0, 255))
def test_a_file_with_one_byte_changed_is_damaged_or_says_the_same(tmp_path_factory, place, value):
    store = FileStore(tmp_path_factory.mktemp("state"), "drive")
    store.save(VALUES)
    content = bytearray(store.path.read_bytes())
    content[place % len(content)] = value
    store.path.write_bytes(content)
    try:
        loaded = store.load()
    except StoreDamagedError:
        loaded = VALUES
    assert loaded == VALUES


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"null", b"\xff\xfe", b'{"values": {}}', b'{"values": 3, "crc32": 0}',
     json.dumps({"values": {"2000:00": 70}, "crc32": 1}).encode(), b"[" * 100_000],
)  # fmt: skip
def test_a_file_that_is_no_store_is_damaged(tmp_path, content):
    store = FileStore(tmp_path, "drive")
    store.path.write_bytes(content)
    with pytest.raises(StoreDamagedError, match=r"drive\.json"):
        store.load()


def test_a_truncated_file_is_damaged(tmp_path):
    store = FileStore(tmp_path, "drive")
    store.save(VALUES)
    whole = store.path.read_bytes()
    for length in range(len(whole)):
        store.path.write_bytes(whole[:length])
        with pytest.raises(StoreDamagedError):
            store.load()


def test_a_crash_before_the_rename_leaves_the_old_parameters(tmp_path, monkeypatch):
    store = FileStore(tmp_path, "drive")
    store.save(VALUES)

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        store.save({(0x2000, 0): 1})
    assert store.load() == VALUES
    assert [each.name for each in tmp_path.iterdir()] == ["drive.json"]
