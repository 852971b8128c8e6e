"""The flight recorder's files: dumps after faults and crashes, continuous records, bounds."""

import functools
import os
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from robotctl.app.processes import control
from robotctl.app.processes.recorder import RobotRecorder
from robotctl.app.processes.robot import make_core, record_header
from robotctl.cli.commands import app
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.core.checkpoint import checkpoint
from robotctl.core.control_core import ControlCore, Inputs
from robotctl.drivers.can.nodes.motor import WheelFeedback
from robotctl.logs import flight
from robotctl.logs.flight import AFTERMATH_NS, MOST_DUMPS, FlightDumps, RecordCopy
from robotctl.messages.control import ControlState, Feedback, LoopStatistics, SafetyState
from robotctl.runtime.clock import RealClock
from robotctl.runtime.flight.recorder import Recorder, RecordError
from robotctl.runtime.flight.ring import FlightRing
from robotctl.runtime.ipc.topics import ring_path
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder
from robotctl.runtime.storage.ring_file import crashed
from robotctl.workbench.replay.replay import differences, replay_file
from tests.native_frames import reports

OPTIONS = StackOptions("robot", str(find_file("diff_drive").resolve()))
CONFIG = load_robot(find_file("diff_drive"))
STATE = make_core(CONFIG, OPTIONS).snapshot(0, LoopStatistics())
SMALL = 4, 1 << 16


class Loop:
    """A control loop that writes a ring."""

    def __init__(self, path: Path) -> None:
        self.core: ControlCore = make_core(CONFIG, OPTIONS)
        self.ring = FlightRing(
            path,
            record_header(CONFIG, OPTIONS),
            functools.partial(checkpoint, self.core),
            *SMALL,
        )
        self.now_ns = 0

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.now_ns += CONFIG.runtime.period_ns
            turns = self.now_ns // 1000
            wheels = WheelFeedback(self.now_ns, turns & 0xFFFFF, (turns // 50 & 0xFFFF, 7))
            inputs = Inputs(Feedback(actuators=reports(wheels, None, None)))
            self.ring.record(self.now_ns, inputs, self.core.step(inputs, self.now_ns), 0, 0)


@pytest.fixture
def loop(tmp_path: Path) -> Loop:
    return Loop(tmp_path / "a.ring")


def state(state: SafetyState) -> ControlState:
    return msgspec.structs.replace(STATE, state=state)


@pytest.mark.parametrize("stop", [SafetyState.FAULT, SafetyState.EMERGENCY_STOP])
def test_a_stop_is_dumped_once_with_what_came_of_it(
    tmp_path: Path, loop: Loop, stop: SafetyState
) -> None:
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    loop.ticks(100)
    assert dumps.step([state(SafetyState.DRIVING)], 0) == ()
    assert dumps.step([state(stop), state(stop)], 10) == ()
    loop.ticks(200)
    assert dumps.step([state(stop)], AFTERMATH_NS) == ()
    (note,) = dumps.step([state(stop)], AFTERMATH_NS + 10)
    (file,) = (tmp_path / "flights").iterdir()
    assert str(file) in note
    assert file.name.startswith("fault-")
    assert replay_file(file).result.agreed == 300
    assert dumps.step([state(stop)], 10 * AFTERMATH_NS) == ()
    dumps.step([state(SafetyState.STANDBY), state(stop)], 11 * AFTERMATH_NS)
    (note,) = dumps.close()
    assert len(list((tmp_path / "flights").iterdir())) == 2


def test_a_stop_is_dumped_though_control_ends_and_removes_its_ring_before(
    tmp_path: Path, loop: Loop
) -> None:
    """As where the CAN adapter is unplugged: systemd ends the service at once."""
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    loop.ticks(100)
    assert dumps.step([state(SafetyState.FAULT)], 0) == ()
    loop.ring.close()
    assert not (tmp_path / "a.ring").exists()
    (note,) = dumps.close()
    assert "flight recorder written to" in note
    (fault,) = (tmp_path / "flights").glob("fault-*.rec")
    assert replay_file(fault).result.agreed == 100


def test_a_stop_that_is_heard_after_control_has_removed_its_ring_is_dumped(
    tmp_path: Path, loop: Loop
) -> None:
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    loop.ticks(100)
    assert dumps.step([], 0) == ()
    loop.ring.close()
    assert dumps.step([state(SafetyState.FAULT)], 0) == ()
    (note,) = dumps.close()
    assert "flight recorder written to" in note


def test_a_crash_is_dumped_by_whoever_comes_next(tmp_path: Path, loop: Loop) -> None:
    loop.ticks(1000)
    loop.ring._let_go()
    second = Loop(tmp_path / "a.ring")
    second.ticks(3)
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    (note,) = dumps.step([], 0)
    (file,) = (tmp_path / "flights").iterdir()
    assert file.name.startswith("crash-")
    assert str(file) in note
    result = replay_file(file).result
    assert result.difference is None
    assert result.agreed > 300
    assert not crashed(tmp_path / "a.ring").exists()
    assert dumps.step([], 0) == ()


def test_a_stop_that_a_crash_follows_is_in_the_dump_of_the_crash_and_in_no_other(
    tmp_path: Path, loop: Loop
) -> None:
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    loop.ticks(100)
    assert dumps.step([state(SafetyState.FAULT)], 0) == ()
    loop.ring._let_go()
    second = Loop(tmp_path / "a.ring")
    (note,) = dumps.step([state(SafetyState.BOOT)], AFTERMATH_NS)
    assert "crash-" in note
    assert dumps.step([], 2 * AFTERMATH_NS) == ()
    (file,) = (tmp_path / "flights").iterdir()
    assert replay_file(file).result.agreed == 100
    second.ring.close()


def test_the_oldest_dumps_go(tmp_path: Path, loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    flights = tmp_path / "flights"
    flights.mkdir()
    for number in range(MOST_DUMPS + 5):
        old = flights / f"fault-{number:02d}.rec"
        old.write_bytes(b"")
        os.utime(old, (number, number))
    (flights / "mine.rec").write_bytes(b"")
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    dumps.step([state(SafetyState.FAULT)], 0)
    dumps.close()
    left = sorted(path.name for path in flights.iterdir())
    assert len(left) == MOST_DUMPS + 1
    assert "mine.rec" in left
    assert "fault-05.rec" not in left
    assert "fault-06.rec" in left


def test_dumps_of_before_the_clock_was_put_back_go_before_a_new_one(
    tmp_path: Path, loop: Loop
) -> None:
    flights = tmp_path / "flights"
    flights.mkdir()
    for number in range(MOST_DUMPS):
        old = flights / f"fault-{number:02d}.rec"
        old.write_bytes(b"")
        os.utime(old, (4e9 + number, 4e9 + number))
    dumps = FlightDumps(tmp_path / "a.ring", flights)
    dumps.step([state(SafetyState.FAULT)], 0)
    (note,) = dumps.close()
    assert Path(note.removeprefix("flight recorder written to ")).exists()
    assert {path.name for path in flights.glob("fault-0?.rec")} == {
        f"fault-{number:02d}.rec" for number in range(1, 10)
    }


def test_a_dump_that_cannot_be_written_is_said(tmp_path: Path, loop: Loop) -> None:
    (tmp_path / "flights").write_text("in the way")
    dumps = FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    dumps.step([state(SafetyState.FAULT)], 0)
    (note,) = dumps.close()
    assert "the flight recorder is not written" in note


def test_the_continuous_record_holds_every_tick_over_files_and_lives(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    copy = RecordCopy(tmp_path / "a.ring", LogFolder(logs, LogConfig(0.1, 10.0)))
    copy.step()
    loop = Loop(tmp_path / "a.ring")
    for _ in range(40):
        loop.ticks(50)
        copy.step()
    loop.ticks(20)
    loop.ring.close()
    copy.step()
    again = Loop(tmp_path / "a.ring")
    again.ticks(30)
    copy.step()
    copy.close()
    files = sorted(logs.iterdir())
    assert [file.name for file in files] == [
        f"control-{number:04d}.rec" for number in range(1, len(files) + 1)
    ]
    assert len(files) > 3
    results = [replay_file(file).result for file in files]
    assert all(result.difference is None and result.gaps == 0 for result in results)
    assert sum(result.agreed for result in results) == 40 * 50 + 20 + 30
    assert results[-1].agreed == 30
    assert all(file.stat().st_size < 0.1e6 + SMALL[1] for file in files)


def test_a_record_that_somebody_removes_is_begun_anew_with_all_that_the_ring_holds(
    tmp_path: Path, loop: Loop
) -> None:
    logs = tmp_path / "logs"
    copy = RecordCopy(tmp_path / "a.ring", LogFolder(logs, LogConfig()))
    loop.ticks(50)
    copy.step()
    (logs / "control-0001.rec").unlink()
    loop.ticks(50)
    copy.step()
    copy.close()
    (file,) = logs.iterdir()
    assert replay_file(file).result.agreed == 100


def test_a_disk_that_refuses_the_log_is_tried_again_and_said_as_long_as_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    options = msgspec.structs.replace(OPTIONS, record=str(tmp_path / "logs"))
    recording = RobotRecorder(CONFIG, options)
    loop = Loop(ring_path("robot"))
    loop.ticks(10)
    logs = tmp_path / "logs"
    logs.rmdir()
    notes = [recording.step([], second * 1_000_000_000) for second in range(25)]
    assert [second for second, said in enumerate(notes) if said] == [0, 10, 20]
    for second in (0, 10, 20):
        assert "logging stopped: " in notes[second][0]
        assert "No such file" in notes[second][0]
    logs.mkdir()
    loop.ticks(10)
    recording.step([], 40_000_000_000)
    loop.ring.close()
    recording.finish(list, RealClock())
    assert replay_file(logs / "control-0001.rec").result.agreed == 20


def test_a_recorder_that_ends_leaves_no_ring_of_a_dead_process_and_every_ring_of_a_live_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("robotctl.app.processes.recorder._END_NS", 0)
    path = ring_path("robot")
    options = msgspec.structs.replace(OPTIONS, flights=str(tmp_path / "flights"))
    dead = Loop(path)
    dead.ticks(50)
    dead.ring._let_go()
    RobotRecorder(CONFIG, options).finish(list, RealClock())
    assert not path.exists()
    assert not crashed(path).exists()
    (file,) = (tmp_path / "flights").iterdir()
    assert file.name.startswith("crash-")
    live = Loop(path)
    RobotRecorder(CONFIG, options).finish(list, RealClock())
    assert path.exists()
    live.ring.close()


def test_the_folder_is_bounded_and_only_logs_are_removed(tmp_path: Path) -> None:
    folder = LogFolder(tmp_path, LogConfig(0.1, 1.0))
    (tmp_path / "notes.txt").write_bytes(bytes(10**6))
    for number in range(30):
        path = folder.new("control", "rec")
        path.write_bytes(bytes(100_000))
        os.utime(path, (number, number))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [*(f"control-{number:04d}.rec" for number in range(20, 31)), "notes.txt"]


def dump_to(target: Path) -> bool:
    """Ask for a dump; return whether it was made, and not refused."""
    done = CliRunner().invoke(app, ["record", "dump", str(target), "--instance", "robot"])
    assert isinstance(done.exception, RecordError | None), done.exception
    return done.exception is None


def test_a_record_is_dumped_on_request_and_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    loop = Loop(ring_path("robot"))
    loop.ticks(77)
    target = tmp_path / "wanted.rec"
    assert dump_to(target)
    shown = CliRunner().invoke(app, ["replay", str(target)])
    assert shown.exit_code == 0
    assert "77 ticks, all outputs the same bit for bit" in shown.output
    loop.ring.close()


def test_two_dumps_within_a_second_are_two_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    loop = Loop(ring_path("robot"))
    loop.ticks(5)
    for _ in range(3):
        assert CliRunner().invoke(app, ["record", "dump", "--instance", "robot"]).exit_code == 0
    assert len(list(tmp_path.glob("flight-*Z.rec"))) == 3
    loop.ring.close()


def test_a_dump_replaces_records_alone_and_follows_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    loop = Loop(ring_path("robot"))
    loop.ticks(5)
    fifo, text, link = tmp_path / "fifo", tmp_path / "robot.toml", tmp_path / "link.rec"
    os.mkfifo(fifo)
    text.write_text("x = 1")
    link.symlink_to(tmp_path / "real.rec")
    assert not dump_to(fifo)
    assert fifo.is_fifo()
    assert not dump_to(text)
    assert text.read_text() == "x = 1"
    assert dump_to(link)
    assert link.is_symlink()
    assert dump_to(tmp_path / "real.rec")
    assert replay_file(link).result.agreed == 5
    loop.ring.close()


def test_a_record_of_a_robot_without_a_slew_limit_is_replayed(tmp_path: Path) -> None:
    config = load_robot(find_file("diff_drive"), ("control.pwm.slew_per_s=inf",))
    core = make_core(config, OPTIONS)
    path = tmp_path / "a.rec"
    with path.open("wb") as file:
        recorder = Recorder(file.write, record_header(config, OPTIONS))
        for number in range(1, 20):
            now_ns = number * config.runtime.period_ns
            inputs = Inputs(Feedback())
            recorder.record(now_ns, inputs, core.step(inputs, now_ns))
    replayed = replay_file(path)
    assert (replayed.result.agreed, replayed.result.difference) == (19, None)


def test_a_replay_that_differs_shows_tick_and_both_values(tmp_path: Path, loop: Loop) -> None:
    loop.ticks(40)
    core = loop.core
    inputs = Inputs(Feedback())
    outputs = core.step(inputs, loop.now_ns + 5_000_000)
    command = msgspec.structs.replace(outputs.command, values=(0.25,))
    bent = msgspec.structs.replace(outputs, command=command)
    loop.ring.record(loop.now_ns + 5_000_000, inputs, bent, 0, 0)
    copy = RecordCopy(tmp_path / "a.ring", LogFolder(tmp_path, LogConfig()))
    copy.step()
    copy.close()
    file = tmp_path / "control-0001.rec"
    difference = replay_file(file).result.difference
    assert difference is not None
    assert differences(difference) == [("command.values", "(0.25,)", "()")]
    shown = CliRunner().invoke(app, ["replay", str(file)])
    assert shown.exit_code == 1
    assert "40 ticks agree" in shown.output
    assert "tick 41 of the run, at 205000000 ns, differs" in shown.output
    assert "command.values: recorded (0.25,), computed ()" in shown.output


def test_dumps_are_named_by_wall_time_in_utc(tmp_path: Path, loop: Loop) -> None:
    dumps = flight.FlightDumps(tmp_path / "a.ring", tmp_path / "flights")
    dumps.step([state(SafetyState.FAULT)], 0)
    dumps.close()
    (file,) = (tmp_path / "flights").iterdir()
    assert file.match("fault-20[0-9][0-9][01][0-9][0-3][0-9]T[0-9]*Z.rec")


def test_a_defect_in_the_loop_leaves_the_ring_for_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Robot:
        """No feedback, no motors."""

        is_closed = False

        def receive(self, _: int) -> Feedback:
            return Feedback()

        def send(self, *_: object) -> None:
            pass

        def close(self) -> None:
            self.is_closed = True

    def step(core: ControlCore, inputs: Inputs, now_ns: int) -> object:
        assert core._ticks < 50, "a defect"
        return sound(core, inputs, now_ns)

    robot, sound = Robot(), ControlCore.step
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(control, "make_robot", lambda *_: robot)
    monkeypatch.setattr(control, "acquire_realtime", lambda _: [])
    monkeypatch.setattr(control, "rehearse", lambda *_: True)
    monkeypatch.setattr(ControlCore, "step", step)
    with pytest.raises(AssertionError, match="a defect"):
        control.run(replace(CONFIG, can=replace(CONFIG.buses[0], channel="none")), OPTIONS)
    assert robot.is_closed
    path = ring_path(OPTIONS.instance)
    assert path.exists()
    path.unlink()
