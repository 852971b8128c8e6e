"""The flight ring: what is in it after it went round, after SIGKILL, and while it is written."""

import functools
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from robotctl.core.checkpoint import checkpoint
from robotctl.core.control_core import ControlCore
from robotctl.errors import LinkError
from robotctl.runtime.flight import ring as flight_ring
from robotctl.runtime.flight.recorder import (
    Checkpoint,
    RecordError,
    RecordHeader,
    Tick,
    read_record,
    replay,
)
from robotctl.runtime.flight.ring import FlightRing, RingReader, dump
from robotctl.runtime.storage.ring_file import MOST_DEAD, crashed, is_written
from tests.core.robot_double import RobotDouble, make_core

HEADER = RecordHeader("0", "{}", 1.0, 2.0, 0.0)
SMALL = 4, 1 << 16


def make_ring(path: Path, core: ControlCore) -> FlightRing:
    return FlightRing(path, HEADER, functools.partial(checkpoint, core), *SMALL)


def drive(robot: RobotDouble, ring: FlightRing, ticks: int) -> None:
    for step in range(ticks):
        robot.tick(robot.velocity(0.4, 0.3 if step % 100 < 50 else -0.3))
        ring.record(*robot.record[-1], 1000, 2000)


def entries_of(path: Path) -> list[Checkpoint | Tick]:
    with path.open("rb") as file:
        _, entries = read_record(file, str(path))
        return list(entries)


@pytest.mark.parametrize("ticks", [5, 100, 3000, 3050, 3100])
def test_a_dump_replays_bit_for_bit_whether_or_not_the_ring_went_round(
    tmp_path: Path, ticks: int
) -> None:
    robot = RobotDouble()
    ring = make_ring(tmp_path / "a.ring", robot.core)
    drive(robot, ring, 3)
    robot.arm()
    ring.record(*robot.record[-1], 0, 0)
    drive(robot, ring, ticks)
    dump(tmp_path / "a.ring", tmp_path / "a.rec")
    entries = entries_of(tmp_path / "a.rec")
    kept = [entry for entry in entries if isinstance(entry, Tick)]
    assert [tick.now_ns for tick in kept] == [each[0] for each in robot.record[-len(kept) :]]
    assert kept[-1].lag_ns == 1000
    result = replay(make_core, entries, "a.rec")
    assert (result.agreed, result.gaps, result.difference) == (len(kept), 0, None)
    first = entries[0]
    assert isinstance(first, Checkpoint)
    assert first.ticks == len(robot.record) - len(kept)
    if ticks >= 3000:
        assert first.ticks > 0, "the ring did not go round"
        # All segments but the newest are full up to the reserve, wherever the newest stands.
        assert (tmp_path / "a.rec").stat().st_size > (SMALL[0] - 1) * (SMALL[1] - (1 << 15))
    ring.close()


def test_altering_one_byte_of_a_dump_shows_the_tick(tmp_path: Path) -> None:
    robot = RobotDouble().armed()
    ring = make_ring(tmp_path / "a.ring", robot.core)
    ring._ticks = len(robot.record)
    ring._begin_segment()
    drive(robot, ring, 180)
    dump(tmp_path / "a.ring", tmp_path / "a.rec")
    data = bytearray((tmp_path / "a.rec").read_bytes())
    victim = robot.record[-100]
    place = data.index(msgspec.msgpack.encode(victim[0]))
    count = msgspec.msgpack.encode(victim[1].feedback.actuators[0].position_ticks)
    data[data.index(count, place) + len(count) - 1] ^= 1 << 4
    _, entries = read_record(io.BytesIO(data), "a.rec")
    difference = replay(make_core, entries, "a.rec").difference
    assert difference is not None
    assert 0 <= difference.tick.now_ns - victim[0] <= 10_000_000
    assert difference.tick.outputs.command != difference.outputs.command
    ring.close()


def test_a_follower_gets_every_message_once(tmp_path: Path) -> None:
    robot = RobotDouble()
    ring = make_ring(tmp_path / "a.ring", robot.core)
    reader = RingReader(tmp_path / "a.ring")
    data, last = reader.header, None
    for step in range(60):
        drive(robot, ring, 1 + step % 37)
        for part in reader.read(last):
            data, last = data + part.data, part
    assert reader.read(last) == []
    _, entries = read_record(io.BytesIO(data), "x")
    listed = list(entries)
    assert [each.now_ns for each in listed if isinstance(each, Tick)] == [
        each[0] for each in robot.record
    ]
    assert sum(isinstance(each, Checkpoint) for each in listed) > SMALL[0]
    assert not reader.replaced()
    ring.close()
    assert reader.replaced()
    reader.close()


def test_a_follower_that_lags_behind_the_ring_gets_a_gap_that_replays(tmp_path: Path) -> None:
    robot = RobotDouble()
    ring = make_ring(tmp_path / "a.ring", robot.core)
    reader = RingReader(tmp_path / "a.ring")
    drive(robot, ring, 50)
    parts = reader.read()
    drive(robot, ring, 3000)
    parts += reader.read(parts[-1])
    data = reader.header + b"".join(part.data for part in parts)
    _, entries = read_record(io.BytesIO(data), "x")
    result = replay(make_core, entries, "x")
    assert result.gaps == 1
    assert result.difference is None
    assert 50 < result.agreed < 3050
    reader.close()
    ring.close()


def test_a_tick_that_no_segment_holds_is_a_gap_and_no_crash(tmp_path: Path) -> None:
    robot = RobotDouble()
    ring = make_ring(tmp_path / "a.ring", robot.core)
    drive(robot, ring, 10)
    robot.tick(*[robot.velocity(0.1, 0.0)] * 3000)
    ring.record(*robot.record[-1], 0, 0)
    drive(robot, ring, 10)
    dump(tmp_path / "a.ring", tmp_path / "a.rec")
    result = replay(make_core, entries_of(tmp_path / "a.rec"), "a.rec")
    assert (result.agreed, result.gaps, result.difference) == (20, 1, None)
    ring.close()


def test_a_state_that_cannot_be_saved_stops_neither_the_loop_nor_the_record(
    tmp_path: Path,
) -> None:
    robot = RobotDouble()

    def unsaved() -> bytes:
        raise TypeError("cannot pickle 'generator' object")

    ring = FlightRing(tmp_path / "a.ring", HEADER, unsaved, *SMALL)
    drive(robot, ring, 200)
    dump(tmp_path / "a.ring", tmp_path / "a.rec")
    assert replay(make_core, entries_of(tmp_path / "a.rec"), "a.rec").agreed == 200
    ring.close()


KILLED = """
import functools, os, sys, time
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from tests.core.robot_double import RobotDouble
from tests.runtime.flight.test_ring import drive, make_ring
robot = RobotDouble()
ring = make_ring(Path(sys.argv[1]), robot.core)
drive(robot, ring, 3)
robot.arm()
ring.record(*robot.record[-1], 0, 0)
while True:
    drive(robot, ring, 1)
    if len(robot.record) == 1000:
        print("on its way", flush=True)
"""


@pytest.mark.parametrize("delay_s", [0.0, 0.0313, 0.0701])
def test_the_ring_of_a_killed_process_replays_to_its_last_tick(
    tmp_path: Path, delay_s: float
) -> None:
    path = tmp_path / "a.ring"
    child = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path), str(Path(__file__).parents[3])],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
    )
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"on its way\n"
        end_s = time.monotonic() + delay_s
        while time.monotonic() < end_s:
            dump(path, tmp_path / "live.rec")
        child.send_signal(signal.SIGKILL)
        child.wait()
    dump(path, tmp_path / "a.rec")
    result = replay(make_core, entries_of(tmp_path / "a.rec"), "a.rec")
    assert (result.gaps, result.difference) == (0, None)
    assert result.agreed > 200
    if delay_s:
        live = replay(make_core, entries_of(tmp_path / "live.rec"), "live.rec")
        assert live.difference is None
    ring = make_ring(path, make_core())
    dump(crashed(path), tmp_path / "b.rec")
    assert (tmp_path / "b.rec").read_bytes() == (tmp_path / "a.rec").read_bytes()
    ring.close()
    assert not path.exists()


BUSY = """
import sys
from pathlib import Path
from robotctl.runtime.flight.ring import FlightRing
from tests.core.robot_double import RobotDouble
from tests.runtime.flight.test_ring import HEADER, SMALL
robot = RobotDouble()
robot.tick(robot.velocity(0.4, 0.3))
ring = FlightRing(Path(sys.argv[1]), HEADER, lambda: b"", *SMALL)
print("on its way", flush=True)
while True:
    ring.record(*robot.record[0], 1000, 2000)
"""


def test_the_fill_mark_of_a_segment_never_goes_back(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", BUSY, str(tmp_path / "a.ring")],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
    )
    seen: dict[int, int] = {}
    back = []
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"on its way\n"
        reader = RingReader(tmp_path / "a.ring")
        end_s = time.monotonic() + 1.5
        while time.monotonic() < end_s:
            for index in range(SMALL[0]):
                sequence, used = reader._segment_head((1 << 16) + index * SMALL[1])
                if sequence and not seen.get(sequence, 1) <= used <= SMALL[1]:
                    back.append((sequence, seen.get(sequence), used))
                seen[sequence] = used
        reader.close()
        child.kill()
    assert back == []
    assert len(seen) > 20


def test_a_segment_that_begins_while_a_follower_reads_costs_it_nothing(tmp_path: Path) -> None:
    robot = RobotDouble()
    ring = make_ring(tmp_path / "a.ring", robot.core)

    class Reader(RingReader):
        """Is as slow as can be: the loop goes on before each of its looks."""

        def _segment_head(self, place: int) -> tuple[int, int]:
            drive(robot, ring, 3)
            return super()._segment_head(place)

    reader = Reader(tmp_path / "a.ring")
    data, last = reader.header, None
    for _ in range(40):
        for part in reader.read(last):
            data, last = data + part.data, part
    for part in RingReader(tmp_path / "a.ring").read(last):
        data += part.data
    _, entries = read_record(io.BytesIO(data), "x")
    listed = list(entries)
    assert sum(isinstance(each, Checkpoint) for each in listed) > SMALL[0]
    assert [each.now_ns for each in listed if isinstance(each, Tick)] == [
        each[0] for each in robot.record
    ]
    ring.close()


def test_a_ring_that_is_just_being_made_is_read_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Head:
        """The head's encoding, which leaves the computer to a reader when it is done."""

        size = flight_ring._HEAD.size

        def pack_into(self, *arguments: object) -> None:
            flight_ring_head.pack_into(*arguments)
            with pytest.raises(RecordError, match="being created"):
                RingReader(tmp_path / "a.ring")

        def unpack(self, data: bytes) -> tuple[object, ...]:
            return flight_ring_head.unpack(data)

    flight_ring_head = flight_ring._HEAD
    monkeypatch.setattr(flight_ring, "_HEAD", Head())
    ring = make_ring(tmp_path / "a.ring", make_core())
    (part,) = RingReader(tmp_path / "a.ring").read()
    assert part.begins_segment
    ring.close()


def test_what_is_no_ring_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="cannot be read: No such file"):
        RingReader(tmp_path / "none")
    for content in (b"", b"x" * 10_000):
        (tmp_path / "text").write_bytes(content)
        with pytest.raises(RecordError, match="not a flight ring"):
            RingReader(tmp_path / "text")


def test_a_ring_that_cannot_be_made_says_where(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"none/a\.ring: cannot be created: No such file"):
        make_ring(tmp_path / "none" / "a.ring", make_core())


def test_the_ring_of_a_live_process_is_not_taken_away(tmp_path: Path) -> None:
    ring = make_ring(tmp_path / "a.ring", make_core())
    with pytest.raises(LinkError, match=r"a\.ring: another process writes it"):
        make_ring(tmp_path / "a.ring", make_core())
    assert is_written(tmp_path / "a.ring")
    ring.close()
    assert not is_written(tmp_path / "a.ring")


def test_the_rings_of_many_dead_processes_do_not_fill_the_memory(tmp_path: Path) -> None:
    live = make_ring(tmp_path / "live.ring", make_core())
    for number in range(MOST_DEAD + 3):
        dead = make_ring(tmp_path / f"dead-{number}.ring", make_core())
        dead._let_go()
        os.utime(tmp_path / f"dead-{number}.ring", (number, number))
    make_ring(tmp_path / "next.ring", make_core()).close()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(f"dead-{number}.ring" for number in range(3, MOST_DEAD + 3)),
        "live.ring",
    ]
    live.close()
