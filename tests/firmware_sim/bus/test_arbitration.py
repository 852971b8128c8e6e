"""Who gets the bus, when, and what the others see."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bus.bits import frame_bits
from firmware_sim.bus.core import Bus
from firmware_sim.bus.frame import EXTENDED_FLAG, REMOTE_FLAG, Filter

MILLISECOND = 1_000_000


def wire_order(can_id):
    """The bits a node sends while it competes, as text; written out, not computed."""
    remote = "1" if can_id & REMOTE_FLAG else "0"
    if can_id & EXTENDED_FLAG:
        text = format(can_id & 0x1FFFFFFF, "029b")
        return text[:11] + "11" + text[11:] + remote
    return format(can_id & 0x7FF, "011b") + remote + "0"


ids = st.builds(
    lambda plain, extended, remote: (
        (plain | EXTENDED_FLAG if extended else plain & 0x7FF) | (REMOTE_FLAG if remote else 0)
    ),
    st.one_of(st.integers(0, 0x1FFFFFFF), st.integers(0, 3).map(lambda value: value << 18)),
    st.booleans(),
    st.booleans(),
)


def listening(bus, name="listener", **options):
    received = []
    bus.attach(name, received.append, **options)
    return received


@given(st.lists(ids, min_size=1, max_size=8, unique=True), st.randoms())
def test_frames_offered_together_come_in_the_order_of_their_bits(offered, random):
    bus = Bus()
    received = listening(bus)
    ports = [bus.attach(f"node{index}", lambda frame: None) for index in range(len(offered))]
    pairs = list(zip(ports, offered, strict=True))
    random.shuffle(pairs)
    for port, can_id in pairs:
        assert port.send(can_id, b"\x00" if not can_id & REMOTE_FLAG else b"")
    bus.advance(10 * MILLISECOND)
    assert [frame.arbitration_id for frame in received] == sorted(offered, key=wire_order)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (0x100, 0x101),
        (0x100, 0x100 | REMOTE_FLAG),
        (0x100, (0x100 << 18) | EXTENDED_FLAG),
        (0x100 | REMOTE_FLAG, (0x100 << 18) | EXTENDED_FLAG),
        (((0x100 << 18) | EXTENDED_FLAG), 0x101),
        (0x1000 | EXTENDED_FLAG, 0x1000 | EXTENDED_FLAG | REMOTE_FLAG),
    ],
)
def test_the_more_urgent_frame_goes_first_and_the_other_counts_a_loss(first, second):
    bus = Bus()
    received = listening(bus)
    late, early = bus.attach("late", lambda frame: None), bus.attach("early", lambda frame: None)
    late.send(second)
    early.send(first)
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [first, second]
    assert (early.statistics.arbitration_lost, late.statistics.arbitration_lost) == (0, 1)


def test_a_frame_is_complete_after_its_bits_and_the_next_after_three_more():
    bus = Bus(bitrate=500_000)
    received = listening(bus)
    port = bus.attach("sender", lambda frame: None)
    bus.advance(12_345)
    port.send(0x181, b"abcdefgh")
    port.send(0x182, b"")
    bus.advance(MILLISECOND)
    first = 12_345 + 2_000 * frame_bits(0x181, b"abcdefgh")
    second = first + 2_000 * (3 + frame_bits(0x182, b""))
    assert [frame.stamp_ns for frame in received] == [first, second]


def test_a_running_frame_is_not_interrupted_by_a_more_urgent_one():
    bus = Bus()
    received = listening(bus)
    low, high = bus.attach("low", lambda frame: None), bus.attach("high", lambda frame: None)
    low.send(0x700, bytes(8))
    bus.advance(1)
    high.send(0x001)
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [0x700, 0x001]


def test_one_node_sends_in_the_order_of_its_queue():
    bus = Bus()
    received = listening(bus)
    port = bus.attach("sender", lambda frame: None)
    for can_id in (0x700, 0x001, 0x300):
        port.send(can_id)
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [0x700, 0x001, 0x300]


def test_an_answer_sent_on_reception_competes_for_the_next_slot():
    bus = Bus()
    received = listening(bus)
    port = bus.attach("host", lambda frame: None)
    drive = bus.attach("drive", lambda frame: frame.arbitration_id == 0x80 and drive.send(0x181))
    port.send(0x080)
    port.send(0x600)
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [0x080, 0x181, 0x600]


def test_frames_at_the_end_of_an_advance_are_delivered_in_it():
    bus = Bus()
    received = listening(bus)
    port = bus.attach("sender", lambda frame: None)
    port.send(0x123, b"1")
    end = bus.bit_ns * frame_bits(0x123, b"1")
    assert bus.next_event_ns == end
    bus.advance(end - 1)
    assert received == []
    bus.advance(end)
    assert received[0].stamp_ns == end
    assert bus.next_event_ns is None


@given(st.lists(st.integers(1, 400_000), min_size=1, max_size=20))
def test_the_size_of_the_steps_changes_nothing(steps):
    def run(pieces):
        bus = Bus()
        received = listening(bus)
        ports = [bus.attach(f"n{index}", lambda frame: None) for index in range(3)]
        for index, port in enumerate(ports):
            for count in range(4):
                port.send(0x100 + 16 * count + index, bytes([count] * 8))
        for piece in pieces:
            bus.advance(bus.now_ns + piece)
        bus.advance(10 * MILLISECOND)
        return received

    assert run(steps) == run([])


def test_the_sender_does_not_hear_itself_but_is_told_when_it_was_sent():
    bus = Bus()
    received, confirmed = [], []
    port = bus.attach("sender", received.append, on_sent=confirmed.append)
    listening(bus)
    port.send(0x123, b"1")
    bus.advance(MILLISECOND)
    assert received == []
    assert [(frame.arbitration_id, frame.data) for frame in confirmed] == [(0x123, b"1")]
    assert port.statistics.sent == 1


@given(st.lists(ids, min_size=1, max_size=20), st.lists(st.tuples(ids, ids), max_size=3))
def test_filters_let_through_what_matches_under_the_mask(sent, masks):
    filters = [Filter(can_id, mask) for can_id, mask in masks]
    bus = Bus()
    everything, some = listening(bus), listening(bus, "some", accept=filters)
    port = bus.attach("sender", lambda frame: None)
    for can_id in sent:
        port.send(can_id)
    bus.advance(100 * MILLISECOND)
    assert [frame.arbitration_id for frame in everything] == sent
    assert some == [
        frame
        for frame in everything
        if any(frame.arbitration_id & mask == can_id & mask for can_id, mask in masks)
    ]


def test_a_plain_id_accepts_itself_only():
    bus = Bus()
    received = listening(bus, accept=[0x181])
    port = bus.attach("sender", lambda frame: None)
    for can_id in (0x181, 0x182, 0x181 | EXTENDED_FLAG, 0x181 | REMOTE_FLAG):
        port.send(can_id)
    bus.advance(10 * MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [0x181]


def test_a_full_queue_refuses_and_takes_again_when_the_bus_moved_on():
    bus = Bus()
    listening(bus)
    port = bus.attach("sender", lambda frame: None, queue_limit=2)
    assert [port.send(0x100 + index) for index in range(3)] == [True, True, False]
    assert port.statistics.refused == 1
    assert port.room == 0
    bus.advance(10)  # the first is on the wire now
    assert port.send(0x103)
    bus.advance(MILLISECOND)
    assert port.statistics.sent == 3


@pytest.mark.parametrize(
    ("can_id", "data", "text"),
    [
        (0x800, b"", "800"),
        (-1, b"", "arbitration id"),
        (EXTENDED_FLAG | 0x20000000, b"", "error messages"),
        (0x123, bytes(9), "9 data bytes"),
    ],
)
def test_what_is_no_frame_is_refused_with_its_reason(can_id, data, text):
    bus = Bus()
    port = bus.attach("sender", lambda frame: None)
    with pytest.raises(ValueError, match=text):
        port.send(can_id, data)


def test_time_does_not_go_back_and_receivers_do_not_move_it():
    bus = Bus()
    bus.advance(10)
    with pytest.raises(ValueError, match="back"):
        bus.advance(9)
    port = bus.attach("a", lambda frame: None)
    bus.attach("b", lambda frame: bus.advance(10**9))
    port.send(0x100)
    with pytest.raises(RuntimeError, match="receiver"):
        bus.advance(MILLISECOND)


def test_a_bitrate_whose_bit_is_no_whole_nanosecond_is_refused():
    with pytest.raises(ValueError, match="83333"):
        Bus(bitrate=83_333)


def test_a_name_is_given_once_and_free_after_detach():
    bus = Bus()
    port = bus.attach("drive", lambda frame: None)
    with pytest.raises(ValueError, match="drive"):
        bus.attach("drive", lambda frame: None)
    port.detach()
    assert bus.attach("drive", lambda frame: None).attached
    with pytest.raises(RuntimeError, match="left the bus"):
        port.send(0x100)


def test_closing_sends_what_is_queued_and_hears_nothing_more():
    bus = Bus()
    received, heard = listening(bus), []
    port, other = bus.attach("a", heard.append), bus.attach("b", lambda frame: None)
    port.send(0x200)
    port.send(0x201)
    other.send(0x100)
    port.close()
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [0x100, 0x200, 0x201]
    assert heard == []
    assert not port.attached
    assert [entry.name for entry in bus.ports] == ["listener", "b"]


def test_who_comes_during_a_frame_hears_the_next_one():
    bus = Bus()
    listening(bus)
    port = bus.attach("sender", lambda frame: None)
    port.send(0x100)
    port.send(0x101)
    bus.advance(10_000)
    late = listening(bus, "late")
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in late] == [0x101]


def test_load_is_the_share_of_busy_bits_and_fades():
    bus = Bus(load_window_ns=100 * MILLISECOND)
    listening(bus)
    port = bus.attach("sender", lambda frame: None)
    bits = 0
    for _ in range(100):
        port.send(0x181, b"\xaa" * 8)
        bits += frame_bits(0x181, b"\xaa" * 8) + 3
        bus.advance(bus.now_ns + MILLISECOND)
    assert bus.load() == pytest.approx(bits / 100_000, rel=0.06)
    counted = bus.statistics.ids[0x181]
    assert (counted.frames, counted.bits) == (100, bits)
    bus.advance(bus.now_ns + 200 * MILLISECOND)
    assert bus.load() < 0.01


def test_two_nodes_sending_the_same_frame_at_once_succeed_both():
    bus = Bus()
    received = listening(bus)
    a, b = bus.attach("a", lambda frame: None), bus.attach("b", lambda frame: None)
    a.send(0x100, b"same")
    b.send(0x100, b"same")
    bus.advance(MILLISECOND)
    assert [(frame.arbitration_id, frame.data) for frame in received] == [(0x100, b"same")]
    assert (a.statistics.sent, b.statistics.sent) == (1, 1)
    assert not bus.statistics.errors


def test_remote_requests_of_one_length_are_one_frame_whatever_data_they_were_given():
    """Of a remote request only the length is sent, so these two never differ on the wire."""
    bus = Bus()
    received = listening(bus)
    a, b = bus.attach("a", lambda frame: None), bus.attach("b", lambda frame: None)
    a.send(0x100 | REMOTE_FLAG, b"one")
    b.send(0x100 | REMOTE_FLAG, b"two")
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in received] == [0x100 | REMOTE_FLAG]
    assert (a.statistics.sent, b.statistics.sent) == (1, 1)
    assert not bus.statistics.errors
