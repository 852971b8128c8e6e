"""A disk without room: nothing is left lying about, and what was stopped goes on when there is."""

import fcntl
import functools
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from robotctl.app.config import find_file, load_robot
from robotctl.app.flight import FlightDumps
from robotctl.app.log_folder import LogConfig, LogFolder
from robotctl.app.logs import BusLog, StateLog, recover_all
from robotctl.app.options import StackOptions
from robotctl.app.recorder import Recording
from robotctl.app.replay import replay_file
from robotctl.app.robot import make_core, record_header
from robotctl.runtime.checkpoint import checkpoint
from robotctl.runtime.clock import RealClock
from robotctl.runtime.core import Inputs
from robotctl.runtime.flight_ring import FlightRing
from robotctl.runtime.messages import Feedback, LoopStatistics, SafetyState
from robotctl.runtime.topics import ring_path

OPTIONS = StackOptions("robot", str(find_file("diff_drive").resolve()))
CONFIG = load_robot(find_file("diff_drive"))


@contextmanager
def full_disk(room: int = 0) -> Iterator[None]:
    """Let the kernel make files and refuse what they would hold beyond `room` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


class Loop:
    """A control loop that writes a ring."""

    def __init__(self, path: Path) -> None:
        self.core = make_core(CONFIG, OPTIONS)
        header = record_header(CONFIG, OPTIONS)
        self.ring = FlightRing(path, header, functools.partial(checkpoint, self.core))
        self.now_ns = 0

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.now_ns += CONFIG.runtime.period_ns
            inputs = Inputs(Feedback())
            self.ring.record(self.now_ns, inputs, self.core.step(inputs, self.now_ns), 0, 0)


def test_a_full_disk_leaves_no_empty_logs_and_they_go_on_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    logs = tmp_path / "logs"
    recording = Recording(CONFIG, msgspec.structs.replace(OPTIONS, record=str(logs)))
    loop = Loop(ring_path("robot"))
    state = loop.core.snapshot(0, LoopStatistics())
    loop.ticks(10)
    with full_disk():
        notes = [recording.step([state], second * 1_000_000_000) for second in range(100)]
        left = [path.name for path in logs.iterdir()]
    assert left == []
    assert [second for second, said in enumerate(notes) if said] == [0]
    now_ns = 200_000_000_000
    assert recording.step([state], now_ns) == ()
    loop.ticks(5)
    assert recording.step([state], now_ns + 1) == ()
    loop.ring.close()
    recording.finish(list, RealClock())
    assert sorted(path.name for path in logs.iterdir()) == ["control-0001.rec", "robot-0001.mcap"]
    assert replay_file(logs / "control-0001.rec").result.agreed == 15


@pytest.mark.parametrize("kind", ["states", "bus"])
def test_each_log_that_is_refused_its_first_bytes_takes_its_file_away(
    tmp_path: Path, kind: str
) -> None:
    folder = LogFolder(tmp_path, LogConfig())
    state = make_core(CONFIG, OPTIONS).snapshot(0, LoopStatistics())
    states, bus = StateLog(folder, 0, "rover"), BusLog(folder, CONFIG.can, 0)
    log = states if kind == "states" else bus

    def write(second: int) -> None:
        if log is states:
            states.step([state], second * 1_000_000_000)
        else:
            bus._write("a frame\n")

    with full_disk():
        for second in range(1, 4):
            with pytest.raises(OSError, match="File too large"):
                write(second)
            with pytest.raises(OSError, match="File too large"):
                log.close()
        left = list(tmp_path.iterdir())
    assert left == []
    write(4)
    log.close()
    (path,) = tmp_path.iterdir()
    assert path.stat().st_size > 0


def test_empty_logs_of_a_disk_that_was_full_go_at_the_next_start_without_a_word(
    tmp_path: Path,
) -> None:
    folder = LogFolder(tmp_path, LogConfig())
    for name in ("robot-0001.mcap", "robot-0002.mcap", "control-0001.rec", "can-0001.log"):
        (tmp_path / name).touch()
    (tmp_path / "notes.txt").touch()
    (tmp_path / "robot-0003.mcap").write_bytes(b"no log")
    (note,) = recover_all(folder)
    assert "robot-0003.mcap" in note
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "robot-0003.mcap"]


def test_a_flight_dump_that_the_disk_refuses_leaves_nothing_and_the_next_one_is_whole(
    tmp_path: Path,
) -> None:
    loop = Loop(tmp_path / "a.ring")
    loop.ticks(200)
    flights = tmp_path / "flights"
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    state = loop.core.snapshot(0, LoopStatistics())
    fault = msgspec.structs.replace(state, state=SafetyState.FAULT)
    with full_disk(room=4096):
        dumps.step([fault], 0)
        (note,) = dumps.close()
        left = list(flights.iterdir())
    assert left == []
    assert "the flight recorder is not written" in note
    dumps.step([state, fault], 0)
    dumps.close()
    (file,) = flights.iterdir()
    assert replay_file(file).result.agreed == 200
    loop.ring.close()


def test_half_a_dump_goes_at_the_next_start_unless_its_writer_lives(tmp_path: Path) -> None:
    for name in ("fault-1.rec.part", "crash-2.rec.part", "fault-3.rec.part", "mine.part"):
        (tmp_path / name).write_bytes(b"half")
    with (tmp_path / "fault-3.rec.part").open("ab") as live:
        fcntl.flock(live, fcntl.LOCK_EX)
        FlightDumps(tmp_path / "a.ring", tmp_path)
        left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["fault-3.rec.part", "mine.part"]
