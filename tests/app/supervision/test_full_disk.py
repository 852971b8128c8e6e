"""A disk without room: nothing is left lying about, and what was stopped goes on when there is."""

import datetime as dt
import errno
import fcntl
import functools
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from robotctl.app.processes.recorder import RobotRecorder
from robotctl.app.processes.robot import make_core, record_header
from robotctl.app.supervision.exit_log import NAME, ExitLog
from robotctl.app.supervision.supervised import Exit
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.core.checkpoint import checkpoint
from robotctl.core.control_core import Inputs
from robotctl.logs.flight import MOST_DUMPS, RETRY_NS, FlightDumps
from robotctl.logs.logs import BusLog, StateLog, recover_all
from robotctl.logs.mcap.recovery import is_complete
from robotctl.messages.control import ControlState, Feedback, LoopStatistics, SafetyState
from robotctl.runtime.clock import RealClock
from robotctl.runtime.flight.ring import FlightRing, dump, dump_size
from robotctl.runtime.ipc.topics import ring_path
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder
from robotctl.runtime.storage.ring_file import crashed, retire
from robotctl.workbench.replay.replay import replay_file

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


def test_half_a_line_of_the_exit_log_is_taken_back(tmp_path: Path) -> None:
    log, ended = ExitLog(tmp_path), Exit("navigation", 17, -9, False, True, False, 42, 1.5, 0.25)
    now, file = dt.datetime.now(dt.UTC), tmp_path / NAME
    assert log.write(ended, now) == ""
    line = file.read_bytes()
    with full_disk(len(line) + 10):
        assert log.write(ended, now).endswith(
            "the end of navigation is not logged: the disk is full"
        )
    assert file.read_bytes() == line
    assert log.write(ended, now) == ""
    assert file.read_bytes() == 2 * line


def test_a_full_disk_leaves_no_empty_logs_and_they_go_on_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    logs = tmp_path / "logs"
    recording = RobotRecorder(CONFIG, msgspec.structs.replace(OPTIONS, record=str(logs)))
    loop = Loop(ring_path("robot"))
    state = loop.core.snapshot(0, LoopStatistics())
    loop.ticks(10)
    with full_disk():
        notes = [recording.step([state], second * 1_000_000_000) for second in range(100)]
        left = [path.name for path in logs.iterdir()]
    assert left == []
    assert [second for second, said in enumerate(notes) if said] == list(range(0, 100, 10))
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
    states, bus = StateLog(folder, 0, "rover"), BusLog(folder, CONFIG.buses, 0)
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


def cut_log(folder: LogFolder) -> Path:
    """A log of some messages whose recorder was killed."""
    states = StateLog(folder, 0, "rover")
    state = make_core(CONFIG, OPTIONS).snapshot(0, LoopStatistics())
    for second in range(1, 20):
        states.step([state], second * 1_000_000_000)
    (path,) = folder.directory.iterdir()
    content = path.read_bytes()
    states.close()
    path.write_bytes(content)
    return path


def test_a_log_that_a_full_disk_does_not_let_be_completed_stays_and_leaves_no_part(
    tmp_path: Path,
) -> None:
    folder = LogFolder(tmp_path, LogConfig())
    path = cut_log(folder)
    content = path.read_bytes()
    with full_disk(room=4096):
        (note,) = recover_all(folder)
        left = list(tmp_path.iterdir())
    assert "was cut and cannot be completed: [Errno 27] File too large" in note
    assert left == [path]
    assert path.read_bytes() == content
    assert "was cut, completed with its 21 messages" in recover_all(folder)[0]


def test_a_completion_is_on_the_disk_before_it_takes_the_place_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def power_cut(descriptor: int) -> None:
        assert is_complete(path.with_name("robot-0001.mcap.part"))
        raise OSError(errno.EIO, "no power")

    folder = LogFolder(tmp_path, LogConfig())
    path = cut_log(folder)
    monkeypatch.setattr(os, "fsync", power_cut)
    (note,) = recover_all(folder)
    assert "no power" in note
    assert not is_complete(path)


def test_half_a_completion_goes_at_the_next_start_unless_its_writer_lives(tmp_path: Path) -> None:
    for name in ("robot-0001.mcap.part", "robot-0002.mcap.part", "mine.mcap.part"):
        (tmp_path / name).write_bytes(b"half")
    with (tmp_path / "robot-0002.mcap.part").open("ab") as live:
        fcntl.flock(live, fcntl.LOCK_EX)
        assert recover_all(LogFolder(tmp_path, LogConfig())) == ()
        left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["mine.mcap.part", "robot-0002.mcap.part"]


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


class SmallDisk:
    """Takes the dumps in a folder up to so many bytes together, and then says what a disk says."""

    def __init__(self, folder: Path, room: int, code: int = errno.ENOSPC) -> None:
        self.folder, self.room, self.code = folder, room, code

    def fsync(self, descriptor: int) -> None:
        if sum(path.stat().st_size for path in self.folder.glob("*.rec*")) > self.room:
            raise OSError(self.code, os.strerror(self.code))


def old_dumps(folder: Path, count: int, size: int) -> None:
    folder.mkdir()
    for number in range(count):
        (folder / f"fault-{number:02d}.rec").write_bytes(bytes(size))
        os.utime(folder / f"fault-{number:02d}.rec", (number, number))
    (folder / "mine.rec").write_bytes(b"")


def fault_of(loop: Loop) -> ControlState:
    state = loop.core.snapshot(0, LoopStatistics())
    return msgspec.structs.replace(state, state=SafetyState.FAULT)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_on_a_full_disk_the_oldest_dumps_make_room_for_a_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    loop = Loop(tmp_path / "a.ring")
    loop.ticks(2000)
    dump(tmp_path / "a.ring", tmp_path / "now.rec")
    size = dump_size(tmp_path / "a.ring")
    assert size == (tmp_path / "now.rec").stat().st_size
    flights = tmp_path / "flights"
    old_dumps(flights, 6, 2 * size // 3)
    monkeypatch.setattr(os, "fsync", SmallDisk(flights, 6 * (2 * size // 3), code).fsync)
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    dumps.step([fault_of(loop)], 0)
    first, second, written = dumps.close()
    assert (
        first == f"the disk is full: {flights}/fault-00.rec is removed to make room for a newer one"
    )
    assert (
        second
        == f"the disk is full: {flights}/fault-01.rec is removed to make room for a newer one"
    )
    (new,) = flights.glob("fault-2*.rec")
    assert written == f"flight recorder written to {new}"
    assert replay_file(new).result.agreed == 2000
    assert sorted(path.name for path in flights.iterdir()) == sorted(
        [*(f"fault-{number:02d}.rec" for number in range(2, 6)), new.name, "mine.rec"]
    )
    loop.ring.close()


def test_where_others_take_the_room_no_more_dumps_go_than_a_new_one_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = Loop(tmp_path / "a.ring")
    loop.ticks(200)
    flights = tmp_path / "flights"
    old_dumps(flights, 6, dump_size(tmp_path / "a.ring") - 1)
    monkeypatch.setattr(os, "fsync", SmallDisk(flights, 0).fsync)
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    dumps.step([fault_of(loop)], 0)
    *removed, refused = dumps.close()
    assert len(removed) == 2
    assert "the flight recorder is not written: [Errno 28] No space left on device" in refused
    assert sorted(path.name for path in flights.iterdir()) == [
        *(f"fault-{number:02d}.rec" for number in range(2, 6)),
        "mine.rec",
    ]
    loop.ring.close()


def test_a_disk_that_refuses_for_another_reason_costs_no_dump(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = Loop(tmp_path / "a.ring")
    flights = tmp_path / "flights"
    old_dumps(flights, 2, 10)
    monkeypatch.setattr(os, "fsync", SmallDisk(flights, 0, errno.EIO).fsync)
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    dumps.step([fault_of(loop)], 0)
    (refused,) = dumps.close()
    assert "Input/output error" in refused
    assert len(list(flights.iterdir())) == 3
    loop.ring.close()


def test_a_crash_waits_in_memory_until_the_disk_takes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = Loop(tmp_path / "a.ring")
    loop.ticks(200)
    loop.ring._let_go()
    retire(tmp_path / "a.ring")
    flights = tmp_path / "flights"
    old_dumps(flights, 6, 3_000_000)
    disk = SmallDisk(flights, 0)
    monkeypatch.setattr(os, "fsync", disk.fsync)
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    assert "is not written" in dumps.step([], 0)[-1]
    assert [dumps.step([], second * 1_000_000_000) for second in range(1, 60)] == [()] * 59
    assert dumps.close() == ()
    assert crashed(tmp_path / "a.ring").exists()
    assert len(list(flights.glob("fault-*.rec"))) == 5
    disk.room = 100_000_000
    (note,) = dumps.step([], 2 * RETRY_NS + 60_000_000_000)
    (file,) = flights.glob("crash-*.rec")
    assert note == f"flight recorder written to {file}"
    assert replay_file(file).result.agreed == 200
    assert not crashed(tmp_path / "a.ring").exists()


def test_a_crash_while_the_one_before_is_written_is_dumped_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(ticks: int) -> None:
        loop = Loop(tmp_path / "a.ring")
        loop.ticks(ticks)
        loop.ring._let_go()
        retire(tmp_path / "a.ring")

    def slow(descriptor: int) -> None:
        monkeypatch.setattr(os, "fsync", lambda _: None)
        crash(70)

    crash(50)
    monkeypatch.setattr(os, "fsync", slow)
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    dumps.step([], 0)
    dumps.step([], 1)
    assert [
        replay_file(path).result.agreed for path in sorted((tmp_path / "flights").iterdir())
    ] == [50, 70]
    assert not crashed(tmp_path / "a.ring").exists()


def test_old_dumps_that_cannot_be_removed_do_not_make_a_new_one_unwritten(tmp_path: Path) -> None:
    loop = Loop(tmp_path / "a.ring")
    flights = tmp_path / "flights"
    (flights / "fault-00.rec").mkdir(parents=True)  # no file
    os.utime(flights / "fault-00.rec", (0, 0))
    for number in range(MOST_DUMPS):
        (flights / f"fault-1{number}.rec").touch()
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    dumps.step([fault_of(loop)], 0)
    written, stays = dumps.close()
    assert written.startswith("flight recorder written to ")
    assert (
        "the oldest dumps of the flight recorder cannot be removed: [Errno 21] Is a directory"
        in stays
    )
    loop.ring.close()


def test_the_last_words_of_a_recorder_are_what_the_disk_refused_at_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("robotctl.app.processes.recorder._END_NS", 0)
    places = {name: str(tmp_path / name) for name in ("record", "flights", "state")}
    recording = RobotRecorder(CONFIG, msgspec.structs.replace(OPTIONS, **places))
    loop = Loop(ring_path("robot"))
    now_ns = RealClock().now_ns()
    moving = msgspec.structs.replace(fault_of(loop), stamp_ns=now_ns, v_m_s=1.0)
    further = msgspec.structs.replace(moving, odometer_m=moving.odometer_m + 1.0)
    recording.step([moving], now_ns)
    recording.step([further], now_ns + 1)
    with full_disk(room=20):
        notes = recording.finish(list, RealClock())
    assert [note[-15:] for note in notes] == [" File too large"] * 3
    assert "state/progress.json" in notes[0]
    assert "the flight recorder is not written" in notes[1]
    assert "the log of the states lacks its end" in notes[2]
    loop.ring.close()


def test_half_a_dump_goes_at_the_next_start_unless_its_writer_lives(tmp_path: Path) -> None:
    for name in ("fault-1.rec.part", "crash-2.rec.part", "fault-3.rec.part", "mine.part"):
        (tmp_path / name).write_bytes(b"half")
    with (tmp_path / "fault-3.rec.part").open("ab") as live:
        fcntl.flock(live, fcntl.LOCK_EX)
        FlightDumps(tmp_path / "a.ring", tmp_path)
        left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["fault-3.rec.part", "mine.part"]
