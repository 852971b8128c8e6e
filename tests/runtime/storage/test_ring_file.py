"""Locks of flight rings: whoever comes between two steps, the ring of a live process stays."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robotctl.errors import LinkError
from robotctl.runtime.flight.recorder import RecordHeader
from robotctl.runtime.flight.ring import FlightRing, RingReader
from robotctl.runtime.storage.ring_file import crashed, is_written, remove_dead, retire

HEADER = RecordHeader("0", "{}", 1.0, 2.0, 0.0)


def make_ring(path: Path) -> FlightRing:
    return FlightRing(path, HEADER, lambda: b"", 4, 1 << 16)


def dead_ring(path: Path) -> None:
    make_ring(path)._let_go()


def before_next(
    monkeypatch: pytest.MonkeyPatch, module: Any, name: str, act: Callable[[], None]
) -> None:
    """Let somebody else act once, just before the next call of a function."""
    real = getattr(module, name)

    def call(*arguments: Any, **more: Any) -> Any:
        monkeypatch.setattr(module, name, real)
        act()
        return real(*arguments, **more)

    monkeypatch.setattr(module, name, call)


def test_a_ring_made_just_before_another_one_opens_it_is_not_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, made = tmp_path / "a.ring", []
    before_next(monkeypatch, os, "open", lambda: made.append(make_ring(path)))
    with pytest.raises(LinkError, match=r"a\.ring: another process writes it"):
        make_ring(path)
    assert path.stat().st_size == (1 << 16) + 4 * (1 << 16)
    assert RingReader(path).read() != []
    made[0].close()


@pytest.mark.parametrize("act", [retire, remove_dead])
def test_a_ring_that_takes_a_dead_ones_place_is_neither_moved_nor_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, act: Callable[[Path], None]
) -> None:
    path, made = tmp_path / "a.ring", []
    dead_ring(path)
    before_next(monkeypatch, fcntl, "flock", lambda: made.append(make_ring(path)))
    act(path)
    assert is_written(path)
    assert crashed(path).exists()
    made[0].close()


@pytest.mark.parametrize("is_empty", [False, True])
def test_a_ring_whose_file_is_taken_away_before_it_is_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_empty: bool
) -> None:
    path = tmp_path / "a.ring"
    if is_empty:
        path.touch()
    else:
        dead_ring(path)
    monkeypatch.setattr("robotctl.runtime.flight.ring.remove_old", lambda _: None)
    before_next(monkeypatch, fcntl, "flock", lambda: retire(path))
    ring = make_ring(path)
    assert is_written(path)
    assert not RingReader(path).replaced()
    assert crashed(path).exists() != is_empty
    ring.close()
    assert not path.exists()


def test_who_asks_whether_a_ring_is_written_does_not_keep_it_from_being_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.ring"
    path.touch()
    probe = os.open(path, os.O_RDONLY)
    fcntl.flock(probe, fcntl.LOCK_SH)
    monkeypatch.setattr("robotctl.runtime.storage.ring_file.time.sleep", lambda _: os.close(probe))
    monkeypatch.setattr("robotctl.runtime.flight.ring.remove_old", lambda _: None)
    ring = make_ring(path)
    assert is_written(path)
    ring.close()


def test_a_file_in_which_no_ring_was_made_replaces_none_of_a_crash(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    dead_ring(path)
    retire(path)
    size = crashed(path).stat().st_size
    path.touch()
    retire(path)
    assert not path.exists()
    assert crashed(path).stat().st_size == size > 0
    retire(path)
    assert crashed(path).exists()
