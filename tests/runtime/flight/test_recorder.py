"""Records: what replays bit for bit, what does not and where, and what is refused."""

import collections
import contextlib
import io
import math
import os
import pickle
import subprocess
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.pid import Pid
from robotctl.core.checkpoint import CheckpointError, checkpoint, fields_of, restored
from robotctl.core.control_core import ControlCore
from robotctl.messages.actuators import DriveState
from robotctl.messages.control import LoopStatistics
from robotctl.runtime.flight.recorder import (
    LENGTH,
    Checkpoint,
    Entry,
    Recorder,
    RecordError,
    RecordHeader,
    Replayed,
    Tick,
    framed,
    is_cut,
    read_record,
    replay,
)
from tests.core.robot_double import RobotDouble, make_core

HEADER = RecordHeader("0", "{}", 1.0, 2.0, 0.0)


def driven(ticks: int = 300) -> RobotDouble:
    """A robot that has been armed, has driven curves, has had a fault and has been armed again."""
    robot = RobotDouble().armed()
    for step in range(ticks):
        if step == ticks // 2:
            robot.motor_state = DriveState.FAULT
        robot.tick(robot.velocity(0.5 * math.sin(step / 50), math.cos(step / 70)))
        if step == ticks // 2 + 5:
            robot.arm()
    return robot


def recorded(robot: RobotDouble) -> bytes:
    file = io.BytesIO()
    recorder = Recorder(file.write, HEADER)
    for entry in robot.record:
        recorder.record(*entry)
    return file.getvalue()


def replayed(data: bytes, make: Callable[[], ControlCore] = make_core) -> Replayed:
    _, entries = read_record(io.BytesIO(data), "x.rec")
    return replay(make, entries, "x.rec")


def message_at(data: bytes, number: int) -> tuple[int, int]:
    """Where the message is that comes after so many others."""
    place = 0
    for _ in range(number):
        place += LENGTH.size + LENGTH.unpack_from(data, place)[0]
    return place, place + LENGTH.size + LENGTH.unpack_from(data, place)[0]


def test_a_recorded_run_replays_bit_for_bit() -> None:
    robot = driven()
    assert replayed(recorded(robot)) == Replayed(len(robot.record), 0, None)


@given(st.integers(1, 200))
@settings(max_examples=10)
def test_a_torn_record_replays_up_to_its_last_whole_tick(cut: int) -> None:
    robot = RobotDouble().armed()
    robot.ticks(20, (0.3, 0.1))
    data = recorded(robot)
    result = replayed(data[:-cut])
    assert result.difference is None
    lost = len(robot.record) - result.agreed
    assert 1 <= lost <= 1 + cut // 50


def test_one_altered_bit_of_an_input_is_shown_with_the_first_tick_that_differs() -> None:
    """Bit 3 of a wheel's count, in the file: 8 of 2400 counts are 1.2 degrees of a wheel."""
    robot = RobotDouble().armed()
    robot.ticks(400, (0.4, 0.2))
    data = bytearray(recorded(robot))
    number = 350
    now_ns, inputs, _ = robot.record[number - 1]
    count = msgspec.msgpack.encode(inputs.feedback.actuators[0].position_ticks)
    assert len(count) == 3
    place, after = message_at(data, 1 + number)
    data[data.index(count, place, after) + 2] ^= 1 << 3
    result = replayed(bytes(data))
    difference = result.difference
    assert difference is not None
    assert difference.number == result.agreed + 1 == number
    assert difference.tick.now_ns == now_ns
    assert difference.tick.outputs == robot.record[number - 1][2]
    assert difference.outputs.command.values[0] != difference.tick.outputs.command.values[0]
    assert difference.outputs.command.values[1] == difference.tick.outputs.command.values[1]


@pytest.mark.parametrize("bent", [1e-300, -0.0])
def test_an_output_that_differs_by_the_last_bit_differs(bent: float) -> None:
    robot = RobotDouble().armed()
    robot.ticks(10)
    number = len(robot.record) - 4
    now_ns, inputs, outputs = robot.record[number]
    assert outputs.command.values == (0.0, 0.0)
    command = msgspec.structs.replace(outputs.command, values=(bent, 0.0))
    robot.record[number] = now_ns, inputs, msgspec.structs.replace(outputs, command=command)
    result = replayed(recorded(robot))
    assert result.agreed == number
    assert result.difference is not None
    assert result.difference.number == number + 1


@given(st.integers(1, 299))
@settings(max_examples=20)
def test_a_core_restored_at_any_tick_goes_on_bit_for_bit(at: int) -> None:
    whole = driven()
    core = make_core()
    for now_ns, inputs, _ in whole.record[:at]:
        core.step(inputs, now_ns)
    again = restored(checkpoint(core))
    for now_ns, inputs, outputs in whole.record[at:]:
        assert again.step(inputs, now_ns) == outputs
    assert again.motion.odometry.pose_odom_base == whole.core.motion.odometry.pose_odom_base


def test_enumerations_as_early_releases_of_python_3_11_write_them_are_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Debian 12 and Raspberry Pi OS have 3.11.2: members are written as attributes there."""
    monkeypatch.setattr(
        DriveState, "__reduce_ex__", lambda self, _: (getattr, (DriveState, self.name))
    )
    robot = driven()
    data = checkpoint(robot.core)
    assert b"getattr" in data
    again = restored(data)
    assert again.snapshot(robot.now_ns, LoopStatistics()) == robot.snapshot()


def test_a_record_with_a_gap_goes_on_at_the_checkpoint_after_it() -> None:
    robot = driven()
    core = make_core()
    entries: list[Entry] = [Checkpoint(0)]
    for number, (now_ns, inputs, outputs) in enumerate(robot.record, 1):
        core.step(inputs, now_ns)
        if not 100 < number <= 150:
            entries.append(Tick(now_ns, inputs, outputs))
        if number == 150:
            entries.append(Checkpoint(150, checkpoint(core)))
    assert replay(make_core, entries, "x.rec") == Replayed(len(robot.record) - 50, 1, None)
    with pytest.raises(RecordError, match="after tick 150 the core's state was not recorded"):
        replay(make_core, [*entries[:101], Checkpoint(150), *entries[102:]], "x.rec")


def test_ticks_without_a_checkpoint_are_refused() -> None:
    robot = RobotDouble()
    robot.ticks(1)
    with pytest.raises(RecordError, match=r"x\.rec: it begins without a checkpoint"):
        replay(make_core, [Tick(*robot.record[0])], "x.rec")


def test_a_record_without_a_tick_is_refused_and_not_the_same() -> None:
    with pytest.raises(RecordError, match=r"x\.rec: no tick is in it"):
        replayed(recorded(RobotDouble()))


def from_the_middle(
    fields: dict[str, tuple[str, ...]], bend: Callable[[ControlCore], object] = id
) -> Replayed:
    """Replay ten ticks from a checkpoint of a core that was bent, by a header of such fields."""
    robot = driven(20)
    bend(robot.core)
    begin = Checkpoint(len(robot.record), checkpoint(robot.core))
    now_ns, inputs, outputs = robot.record[-1]
    file = io.BytesIO()
    recorder = Recorder(file.write, msgspec.structs.replace(HEADER, fields=fields), begin)
    recorder.record(now_ns + 5_000_000, inputs, outputs)
    file.seek(0)
    header, entries = read_record(file, "x.rec")
    return replay(make_core, entries, "x.rec", header.fields)


PID = "robotctl.control.pid.PidConfig"
POSE = "robotctl.model.geometry.se2.SE2"


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (PID, lambda fields: fields[:-1], "has tracking_s here, which it had not"),
        (PID, lambda fields: (*fields, "kx"), "had kx, which it has not here"),
        (POSE, lambda fields: fields[::-1], "had theta_rad, y_m, x_m in this order"),
        ("robotctl.control.pid.Pod", lambda _: ("kp",), "is not here"),
    ],
)
def test_a_checkpoint_whose_classes_had_other_fields_is_refused_by_name(
    name: str, change: Callable[[tuple[str, ...]], tuple[str, ...]], said: str
) -> None:
    fields = fields_of(make_core())
    assert from_the_middle(fields).difference is not None, "the ticks are not the core's next ones"
    fields[name] = change(fields.get(name, ()))
    with pytest.raises(RecordError, match=rf"x\.rec: after tick \d+: .*{name} {said}"):
        from_the_middle(fields)


def test_a_record_of_the_whole_run_needs_no_fields_that_fit() -> None:
    robot = driven(20)
    _, entries = read_record(io.BytesIO(recorded(robot)), "x.rec")
    result = replay(make_core, entries, "x.rec", {PID: ("other",)})
    assert result.agreed == len(robot.record)


@pytest.mark.parametrize("value", ["text", None, ()])
def test_a_restored_core_that_cannot_step_is_refused(value: object) -> None:
    with pytest.raises(RecordError, match=r"x\.rec: its checkpoint is of another robotctl"):
        from_the_middle({}, lambda core: setattr(core._driving, "_period_s", value))


@pytest.mark.parametrize("data", [b"", b"text, and no record\n", b"\xff" * 100, framed(b"\x01")])
def test_what_is_no_record_is_refused(data: bytes) -> None:
    with pytest.raises(RecordError, match=r"x\.rec: "):
        replayed(data)


class Evil:
    def __init__(self, function: object, *arguments: object) -> None:
        self._call = function, arguments

    def __reduce__(self) -> tuple:
        return self._call


@pytest.mark.parametrize(
    "evil",
    [
        Evil(os.system, "true"),
        Evil(subprocess.Popen, ["true"]),
        Evil(eval, "1"),
        Evil(getattr, "x", "upper"),
        Evil(getattr, DriveState, "mro"),
        Evil(getattr, DriveState, "__members__"),
        Evil(Path, "/"),
        Evil(collections.Counter),
        Evil(restored, b""),
    ],
    ids=[
        "system",
        "Popen",
        "eval",
        "getattr",
        "mro",
        "members",
        "Path",
        "Counter",
        "function of robotctl",
    ],
)
def test_a_checkpoint_can_call_nothing(evil: Evil) -> None:
    with pytest.raises(CheckpointError, match="is not allowed in a checkpoint"):
        restored(pickle.dumps(evil))


def test_a_bit_that_flips_anywhere_in_a_record_is_said_or_shows() -> None:
    """It may hit a text, which is no text then, a number, a length, or the configuration."""
    sink = io.BytesIO()
    recorder = Recorder(sink.write, HEADER)
    robot = driven()
    for now_ns, inputs, outputs in robot.record[:40]:
        recorder.record(now_ns, inputs, outputs)
    data = sink.getvalue()
    header, entries = read_record(io.BytesIO(data), "x.rec")
    whole = repr((header, list(entries)))  # in which -0.0 is not 0.0
    unseen, refused = [], 0
    for place in range(0, len(data), 7):
        flipped = bytearray(data)
        flipped[place] ^= 0x80
        try:
            header, entries = read_record(io.BytesIO(bytes(flipped)), "x.rec")
            if repr((header, list(entries))) == whole:
                unseen.append(place)
        except RecordError:
            refused += 1
    assert refused > 100
    assert len(unseen) <= 3  # names of fields whose value is the default


def test_names_that_lead_out_of_a_module_are_refused() -> None:
    data = b"\x80\x04\x8c\x15robotctl.runtime.core\x8c\x0emsgspec.Struct\x93."
    with pytest.raises(CheckpointError, match="is not allowed"):
        restored(data)
    data = b"\x80\x04\x8c\x15robotctl.runtime.core\x8c\x05Twist\x93."
    with pytest.raises(CheckpointError, match="is not allowed"):
        restored(data)


def test_a_checkpoint_of_something_else_is_refused() -> None:
    with pytest.raises(CheckpointError, match="holds a set"):
        restored(pickle.dumps({1}))
    with pytest.raises(CheckpointError, match="holds a Pid"):
        restored(pickle.dumps(make_core()._wheels[0]._pid))
    assert isinstance(make_core()._wheels[0]._pid, Pid)


@given(st.data())
@settings(max_examples=200)
def test_a_damaged_checkpoint_is_an_error_or_a_core(data: st.DataObject) -> None:
    good = bytearray(checkpoint(make_core()))
    place = data.draw(st.integers(0, len(good) - 1))
    good[place] = data.draw(st.integers(0, 255))
    with contextlib.suppress(CheckpointError):
        assert isinstance(restored(bytes(good)), ControlCore)


def test_a_record_that_ends_within_a_message_is_known_as_cut() -> None:
    whole = framed(b"header") + framed(b"tick")
    cuts = [size for size in range(len(whole) + 1) if is_cut(io.BytesIO(whole[:size]))]
    assert cuts == [size for size in range(len(whole)) if size not in (0, len(framed(b"header")))]
