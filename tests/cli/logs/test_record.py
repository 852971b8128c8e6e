"""Which flight recorder `robotctl record dump --instance` means."""

import fcntl
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotctl.cli.logs.record import find_ring
from robotctl.errors import LinkError
from robotctl.runtime.flight.recorder import RecordError
from robotctl.runtime.ipc import topics
from robotctl.runtime.ipc.topics import endpoint_path, ring_folder, ring_path
from tests.cli.command import status_of


@pytest.fixture(autouse=True)
def place(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a folder, its path short enough for sockets, with that of all rings in it."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        folder = Path(name)
        (folder / "memory").mkdir()
        monkeypatch.setattr(topics, "_MEMORY", folder / "memory")
        live_in(folder / "a", monkeypatch)
        yield folder


def live_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let sockets be in a folder, as those of another user session are."""
    folder.mkdir(exist_ok=True)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))


def ring_of(instance: str, ending: str = "") -> Path:
    """Make the file of a ring, of nobody who lives."""
    made = ring_path(instance)
    path = made.with_name(made.name + ending)
    path.write_bytes(b"ring")
    return path


def offered(instance: str = "") -> list[str]:
    """Return the names that a refusal offers."""
    with pytest.raises(RecordError) as refused:
        find_ring(instance)
    _, _, choice = str(refused.value).partition("--instance is one of: ")
    return re.findall(r"(\S+) \(", choice)


def test_each_name_that_is_offered_leads_to_a_ring_of_its_own(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rings = {ring_of("rover")}
    for folder in ("b", "c"):
        live_in(place / folder, monkeypatch)
        rings |= {ring_of("robot"), ring_of("robot", ".crashed"), ring_of("rover-two", ".crashed")}
    live_in(place / "elsewhere", monkeypatch)
    names = offered()
    assert len(names) == len(set(names)) == len(rings) == 7
    assert {find_ring(name) for name in names} == rings
    assert "rover" in names
    assert names == offered("robot") == offered("rover-two")


def test_a_robots_name_means_the_ring_of_our_own_folder_and_the_live_one_before_a_crash(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live_in(place / "b", monkeypatch)
    ring_of("robot")
    live_in(place / "a", monkeypatch)
    crash = ring_of("robot", ".crashed")
    assert find_ring("robot") == crash
    own = ring_of("robot")
    assert find_ring("robot") == own
    assert {"robot", crash.name} <= set(offered())


def test_the_only_ring_needs_no_name() -> None:
    ring = ring_of("robot")
    assert find_ring("") == ring


def test_a_list_says_who_lives_and_since_when() -> None:
    ring_of("rover")
    with ring_of("robot").open() as file, ring_of("second").open() as second:
        fcntl.flock(file, fcntl.LOCK_EX)
        fcntl.flock(second, fcntl.LOCK_EX)
        with pytest.raises(
            RecordError,
            match=r"robot \(runs, begun 2\d{3}-.* UTC\), rover \(ended, .* second \(runs",
        ):
            find_ring("")


def test_the_only_robot_that_runs_is_meant_beside_those_that_crashed() -> None:
    ring_of("rover", ".crashed")
    ring_of("old")
    running = ring_of("robot")
    with running.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert find_ring("") == running
    with pytest.raises(RecordError, match="which robot"):
        find_ring("")


def test_a_typo_gets_the_nearest_name_and_the_list_and_makes_nothing(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ring_of("robot")
    ring_of("rover")
    before = set(place.rglob("*"))
    target = place / "wanted.rec"
    assert status_of("record", "dump", target, "--instance", "robt") == 2
    said = capsys.readouterr().err
    assert 'robt: no flight recorder has that name; did you mean "robot"? --instance is' in said
    assert "rover (ended" in said
    assert offered("xyzzy") == offered("../robot") == ["robot", "rover"]
    assert set(place.rglob("*")) == before
    assert not endpoint_path("robt").exists()


@pytest.mark.parametrize("instance", ["", "robot"])
def test_where_no_robot_ever_ran_a_look_makes_nothing(instance: str, place: Path) -> None:
    before = set(place.rglob("*"))
    with pytest.raises(RecordError, match="no robot is running or has crashed"):
        find_ring(instance)
    assert set(place.rglob("*")) == before


def test_rings_that_others_can_reach_are_not_looked_at() -> None:
    ring_of("robot")
    ring_folder().chmod(0o755)
    with pytest.raises(LinkError, match="closed to others"):
        find_ring("robot")


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_a_dump_goes_into_no_folder(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("record", "dump", folder) == 2
    assert capsys.readouterr().err == f"robotctl: {folder}: is a folder, a file is needed\n"
