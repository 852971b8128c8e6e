"""Faults do what they say, to whom, when, and as often as given; the same for the same seed."""

import dataclasses
import hashlib
import io

import can
import numpy as np
import pytest

from firmware_sim.bus.bits import frame_bits
from firmware_sim.bus.core import Bus
from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import (
    AckLess,
    Babble,
    BitErrors,
    Corrupt,
    Cut,
    Delay,
    Destroy,
    Dominant,
    Drop,
    Duplicate,
    FaultPlan,
    FrameFault,
    Mute,
    Reorder,
    Stale,
)
from firmware_sim.bus.frame import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, Frame
from firmware_sim.bus.log import LogWriter, log_line

MILLISECOND = 1_000_000


def talk(*faults, count=10, seed=0, can_id=0x100):
    """`a` sends numbered frames, one a millisecond; returns the bus and what `b` and `c` got."""
    bus = Bus(seed=seed, faults=FaultPlan(faults))
    a = bus.attach("a", lambda frame: None)
    got = {"b": [], "c": []}
    for name, frames in got.items():
        bus.attach(name, frames.append)
    for number in range(count):
        a.send(can_id, bytes([number, 0]))
        bus.advance(bus.now_ns + MILLISECOND)
    bus.advance(bus.now_ns + 100 * MILLISECOND)
    return bus, got["b"], got["c"]


def numbers(frames):
    return [frame.data[0] for frame in frames]


def test_a_dropped_frame_is_missing_at_one_receiver_only_and_costs_nothing_on_the_wire():
    bus, b, c = talk(Drop(receiver="b", first=3, count=2))
    assert numbers(b) == [0, 1, 2, 5, 6, 7, 8, 9]
    assert numbers(c) == list(range(10))
    assert not bus.statistics.errors


def test_a_frame_dropped_by_all_reaches_nobody():
    _, b, c = talk(Drop(start_ns=2 * MILLISECOND, end_ns=4 * MILLISECOND))
    assert numbers(b) == numbers(c) == [0, 1, 4, 5, 6, 7, 8, 9]


def test_a_duplicated_frame_comes_twice_in_a_row():
    _, b, _ = talk(Duplicate(first=4, count=1))
    assert numbers(b) == [0, 1, 2, 3, 4, 4, 5, 6, 7, 8, 9]


def test_a_delayed_frame_is_overtaken():
    _, b, _ = talk(Delay(delay_ns=2_500_000, first=2, count=1))
    assert numbers(b) == [0, 1, 3, 4, 2, 5, 6, 7, 8, 9]
    assert b[4].stamp_ns == 4_500_000 + 1000 * frame_bits(0x100, b"\x02\x00")


def test_a_reordered_frame_comes_after_its_next_one():
    _, b, _ = talk(Reorder(first=2, count=1))
    assert numbers(b) == [0, 1, 3, 2, 4, 5, 6, 7, 8, 9]


def test_frames_that_are_all_reordered_come_in_swapped_pairs_and_none_is_lost():
    _, b, _ = talk(Reorder(end_ns=5 * MILLISECOND))
    assert numbers(b) == [1, 0, 3, 2, 5, 4, 6, 7, 8, 9]


def test_a_frame_that_waits_for_a_next_one_is_forgotten_with_its_node():
    bus = Bus(faults=FaultPlan((Reorder(count=1),)))
    got = []
    bus.attach("b", got.append)
    for _ in range(2):
        a = bus.attach("a", lambda frame: None)
        a.send(0x100, b"\x07")
        bus.advance(bus.now_ns + MILLISECOND)
        a.detach()
    assert numbers(got) == [7]


def test_a_stale_frame_is_the_last_one_that_was_truly_sent():
    _, b, _ = talk(Stale(first=3, count=3))
    assert numbers(b) == [0, 1, 2, 2, 2, 2, 6, 7, 8, 9]


def test_a_first_frame_has_nothing_stale_to_give_way_to():
    _, b, _ = talk(Stale(end_ns=3 * MILLISECOND))
    assert numbers(b) == [0, 0, 0, 3, 4, 5, 6, 7, 8, 9]


def test_corruption_keeps_the_frame_valid_and_changes_what_it_says():
    bus, b, _ = talk(Corrupt(xor=b"\x00\x81", first=1, count=1))
    assert [frame.data[1] for frame in b] == [0, 0x81, *[0] * 8]
    assert not bus.statistics.errors


def test_random_corruption_inverts_one_bit():
    _, b, _ = talk(Corrupt(), count=50)
    changed = [frame.data[0] ^ number | frame.data[1] << 8 for number, frame in enumerate(b)]
    assert all(mask.bit_count() == 1 for mask in changed)
    assert len(set(changed)) > 5


def test_a_fault_for_one_id_leaves_the_others_alone():
    bus, b, _ = talk(Drop(arbitration_id=0x101), Destroy(arbitration_id=0x101))
    assert numbers(b) == list(range(10))
    assert not bus.statistics.errors


def test_a_fault_for_one_sender_leaves_the_others_alone():
    _, b, _ = talk(Corrupt(node="c", xor=b"\xff"), Drop(node="b"))
    assert numbers(b) == list(range(10))


def test_the_chance_of_a_fault_is_the_one_given():
    _, b, _ = talk(Drop(probability=0.3), count=250)
    assert 250 * 0.3 - 4 * np.sqrt(250 * 0.21) < 250 - len(b) < 250 * 0.3 + 4 * np.sqrt(250 * 0.21)


def test_random_bit_errors_have_their_rate_and_every_frame_arrives():
    rate, count = 1e-3, 250
    bus, b, _ = talk(BitErrors(rate=rate), count=count)
    assert numbers(b) == list(range(count))
    bits = frame_bits(0x100, bytes(2)) - 1
    expected = count * (1 / (1 - rate) ** bits - 1)
    assert expected / 2 < bus.statistics.errors[BusError.BIT_ERROR] < expected * 2


def test_a_mute_node_says_nothing_but_acknowledges():
    bus = Bus(faults=FaultPlan((Mute(node="b", start_ns=MILLISECOND, end_ns=3 * MILLISECOND),)))
    got = []
    a, b = bus.attach("a", got.append), bus.attach("b", lambda frame: None)
    for number in range(5):
        assert b.send(0x200, bytes([number]))
        assert a.send(0x100)
        bus.advance(bus.now_ns + MILLISECOND)
    assert numbers(got) == [0, 3, 4]
    assert b.statistics.discarded == 2
    assert a.statistics.sent == 5


def test_a_babbling_node_without_pause_starves_whoever_is_less_urgent():
    plan = FaultPlan(
        (Babble(node="b", start_ns=MILLISECOND, end_ns=5 * MILLISECOND, arbitration_id=0x010),)
    )
    bus = Bus(faults=plan)
    got = []
    a = bus.attach("a", lambda frame: None)
    bus.attach("b", lambda frame: None)
    bus.attach("c", got.append)
    bus.advance(2 * MILLISECOND)
    a.send(0x100)
    bus.advance(5 * MILLISECOND)
    assert {frame.arbitration_id for frame in got} == {0x010}
    assert bus.load() > 0.75  # four of five milliseconds
    bus.advance(6 * MILLISECOND)
    assert got[-1].arbitration_id == 0x100
    assert bus.next_event_ns is None


def test_a_babbling_node_with_a_period_sends_at_that_rate():
    bus = Bus(faults=FaultPlan((Babble(node="b", arbitration_id=1, period_ns=MILLISECOND),)))
    got = []
    bus.attach("b", lambda frame: None)
    bus.attach("c", got.append)
    bus.advance(100 * MILLISECOND + 500_000)
    assert len(got) == 101
    assert np.diff([frame.stamp_ns for frame in got]).tolist() == [MILLISECOND] * 100


def test_a_fault_may_name_a_node_that_comes_later_and_be_added_while_running():
    bus = Bus(faults=FaultPlan((Mute(node="late"),)))
    got = []
    bus.attach("listener", got.append)
    bus.advance(MILLISECOND)
    late = bus.attach("late", lambda frame: None)
    late.send(0x100)
    bus.advance(2 * MILLISECOND)
    assert got == []
    other = bus.attach("other", lambda frame: None)
    bus.inject(Corrupt(xor=b"\x01", count=1))
    other.send(0x101, b"\x00")
    other.send(0x101, b"\x00")
    bus.advance(3 * MILLISECOND)
    assert [frame.data for frame in got] == [b"\x01", b"\x00"]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Drop(start_ns=5, end_ns=5),
        lambda: Drop(probability=0.0),
        lambda: Drop(probability=1.1),
        lambda: Drop(count=0),
        lambda: Drop(first=-1),
        lambda: Delay(delay_ns=0),
        lambda: Corrupt(xor=b"\x00"),
        lambda: Corrupt(xor=bytes(9)),
        lambda: BitErrors(rate=1.0),
        lambda: Destroy(error=BusError.ACK_ERROR),
        lambda: Destroy(error=BusError.BIT_ERROR, receiver="b"),
        lambda: Destroy(bit=0),
        lambda: Cut(start_ns=-1),
        lambda: Dominant(start_ns=2, end_ns=1),
        lambda: AckLess(node="a", start_ns=2, end_ns=1),
        lambda: Bus(faults=FaultPlan((Babble(node="b", arbitration_id=0x800),))),
    ],
)
def test_faults_that_make_no_sense_are_refused(make):
    with pytest.raises(ValueError, match=r"\d|cannot|receiver"):
        make()


def test_a_base_class_is_no_fault():
    with pytest.raises(TypeError, match="FrameFault"):
        Bus(faults=FaultPlan((FrameFault(),)))


def test_faults_are_values():
    fault = Drop(arbitration_id=0x181, count=1)
    assert fault == Drop(arbitration_id=0x181, count=1)
    assert hash(fault) == hash(Drop(arbitration_id=0x181, count=1))
    with pytest.raises(dataclasses.FrozenInstanceError):
        fault.count = 2


EVERYTHING = (
    BitErrors(rate=3e-4),
    Destroy(probability=0.02),
    Destroy(error=BusError.BIT_STUFFING_ERROR, probability=0.02, receiver="n2"),
    Drop(probability=0.02),
    Corrupt(probability=0.05),
    Delay(delay_ns=700_000, probability=0.05),
    Duplicate(probability=0.05),
    Cut(node="n1", start_ns=100 * MILLISECOND, end_ns=120 * MILLISECOND),
    Dominant(start_ns=200 * MILLISECOND, end_ns=203 * MILLISECOND),
    Babble(node="n3", start_ns=300 * MILLISECOND, end_ns=310 * MILLISECOND),
    Mute(node="n2", start_ns=320 * MILLISECOND, end_ns=340 * MILLISECOND),
    AckLess(node="n0", start_ns=350 * MILLISECOND, end_ns=360 * MILLISECOND),
)


def logged_run(seed, faults=EVERYTHING):
    bus = Bus(500_000, seed, faults=FaultPlan(faults))
    text = io.StringIO()
    log = LogWriter(bus, text)
    rng = np.random.default_rng(7)
    ports = [bus.attach(f"n{index}", lambda frame: None, restart_ms=1) for index in range(4)]
    while bus.now_ns < 400 * MILLISECOND:
        port = ports[rng.integers(4)]
        port.send(int(rng.integers(0x800)), rng.bytes(int(rng.integers(9))))
        bus.advance(bus.now_ns + int(rng.integers(1, 800_000)))
    log.close()
    return text.getvalue()


def test_the_same_seed_writes_the_same_log_byte_for_byte():
    runs = [hashlib.sha256(logged_run(seed).encode()).hexdigest() for seed in (1, 1, 2)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_python_can_reads_the_log_as_it_was_sent(tmp_path):
    bus = Bus()
    sent = [
        (0x181, b"\x01\xff"),
        (0x7FF, b""),
        (0x12345678 & 0x1FFFFFFF | EXTENDED_FLAG, bytes(range(8))),
        (0x5 | EXTENDED_FLAG, b"\x00"),
        (0x201 | REMOTE_FLAG, bytes(4)),
    ]
    a = bus.attach("a", lambda frame: None)
    bus.attach("b", lambda frame: None)
    bus.inject(Destroy(error=BusError.BIT_ERROR, bit=20, count=1))
    with LogWriter(bus, tmp_path / "run.log", "vcan7", epoch_ns=1_700_000_000_000_000_000):
        for can_id, data in sent:
            a.send(can_id, data)
        bus.advance(10 * MILLISECOND)
    with can.CanutilsLogReader(tmp_path / "run.log") as reader:
        error, *messages = list(reader)
    assert error.is_error_frame
    read = [
        (
            message.arbitration_id
            | (EXTENDED_FLAG if message.is_extended_id else 0)
            | (REMOTE_FLAG if message.is_remote_frame else 0),
            bytes(message.dlc) if message.is_remote_frame else bytes(message.data),
        )
        for message in messages
    ]
    assert read == sent
    assert {message.channel for message in messages} == {"vcan7"}
    assert messages[0].timestamp == pytest.approx(1_700_000_000.0002, abs=1e-4)


def test_log_lines_look_as_candump_writes_them():
    assert log_line(Frame(0x181, b"\x01\xab", 1_234_567), "simcan0") == (
        "(0000000000.001234) simcan0 181#01AB\n"
    )
    extended = Frame(0x181 | EXTENDED_FLAG, b"", 0)
    assert log_line(extended, "c") == "(0000000000.000000) c 00000181#\n"
    error = Frame(ERROR_FLAG | 0x88, bytes(8), 0)
    assert log_line(error, "c") == "(0000000000.000000) c 20000088#0000000000000000\n"


def test_a_channel_with_spaces_cannot_be_logged():
    with pytest.raises(ValueError, match="spaces"):
        LogWriter(Bus(), io.StringIO(), "my bus")
