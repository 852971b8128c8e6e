"""Error counters, states and error messages against the rules of ISO 11898-1, clause 12.1.4."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.bus.bits import frame_bits
from firmware_sim.bus.core import Bus
from firmware_sim.bus.errors import BusError, ErrorCounters, ErrorState
from firmware_sim.bus.faults import AckLess, Cut, Destroy, Dominant, FaultPlan, Unanswered

MILLISECOND = 1_000_000
ERROR = 0x20000000  # CAN_ERR_FLAG and below: linux/can/error.h
LOSSES = {"CRTL": 0x004, "PROT": 0x008, "ACK": 0x020, "BUSOFF": 0x040, "RESTARTED": 0x100}
COUNTERS = 0x200


def quiet(frame):
    """Listen and do nothing."""


def two_nodes(*faults, **options):
    """A bus on which `a` talks and `b` listens; both report errors."""
    bus = Bus(faults=FaultPlan(faults))
    heard = {"a": [], "b": []}
    a = bus.attach("a", heard["a"].append, errors=True, **options)
    b = bus.attach("b", heard["b"].append, errors=True, **options)
    return bus, a, b, heard


def errors_of(frames, kind):
    return [
        frame
        for frame in frames
        if frame.arbitration_id & (ERROR | LOSSES[kind]) == ERROR | LOSSES[kind]
    ]


def test_a_lone_node_stays_error_passive_at_128():
    bus = Bus()
    heard = []
    port = bus.attach("alone", heard.append, errors=True)
    port.send(0x123, b"x")
    bus.advance(100 * MILLISECOND)
    assert (port.counters.tec, port.state) == (128, ErrorState.ERROR_PASSIVE)
    assert port.pending == 0
    assert port.statistics.sent == 0
    assert len(errors_of(heard, "ACK")) == 16  # reported while the counter moves: 16 x 8 = 128
    assert bus.statistics.errors[BusError.ACK_ERROR] > 500


def test_a_lone_node_warns_at_96_and_is_passive_at_128():
    bus = Bus()
    heard = []
    bus.attach("alone", heard.append, errors=True).send(0x123, b"x")
    bus.advance(10 * MILLISECOND)
    states = [(frame.data[1], frame.data[6]) for frame in errors_of(heard, "CRTL")]
    assert states == [(0x08, 96), (0x20, 128)]  # TX_WARNING, TX_PASSIVE


def test_the_retries_of_a_lone_node_have_the_timing_of_the_standard():
    """Up to the acknowledge slot, 6 bits of flag, 8 of delimiter, 3 of intermission."""
    bus = Bus()
    heard = []
    bus.attach("alone", heard.append, errors=True).send(0x123, b"x")
    bus.advance(MILLISECOND)
    to_slot = frame_bits(0x123, b"x") - 8
    times = [frame.stamp_ns for frame in errors_of(heard, "ACK")[:3]]
    period = 1000 * (to_slot + 6 + 8 + 3)
    assert times == [1000 * to_slot, 1000 * to_slot + period, 1000 * to_slot + 2 * period]


@settings(max_examples=25)
@given(st.lists(st.integers(1, 3 * MILLISECOND), max_size=60))
def test_the_attempts_of_a_lone_node_are_the_same_in_steps_of_any_size(steps):
    def run(pieces):
        bus = Bus()
        seen = []
        bus.tap(seen.append)
        port = bus.attach("alone", seen.append, errors=True)
        port.send(0x123, b"x")
        port.send(0x124)
        for piece in pieces:
            bus.advance(bus.now_ns + piece)
        bus.advance(200 * MILLISECOND)
        errors = dict(bus.statistics.errors)
        bus.attach("late", seen.append)
        bus.advance(201 * MILLISECOND)
        return seen, errors, port.statistics

    assert run(steps) == run([])


def test_the_owner_may_sleep_while_a_lone_node_tries_in_vain():
    bus = Bus()
    port = bus.attach("alone", quiet)
    port.send(0x123, b"x")
    bus.advance(10 * MILLISECOND)
    assert bus.next_event_ns is None
    late = bus.attach("late", quiet)
    assert bus.next_event_ns <= bus.now_ns + 200_000
    late.send(0x7FF)
    bus.advance(11 * MILLISECOND)
    assert port.statistics.sent == late.statistics.sent == 1


def test_the_frame_gets_through_once_somebody_listens():
    bus = Bus()
    port = bus.attach("alone", quiet)
    port.send(0x123, b"x")
    bus.advance(10 * MILLISECOND)
    received = []
    bus.attach("late", received.append)
    bus.advance(11 * MILLISECOND)
    assert [frame.data for frame in received] == [b"x"]
    assert port.counters.tec == 127


def test_a_node_that_only_listens_acknowledges_nothing():
    bus = Bus()
    port = bus.attach("sender", quiet)
    heard = []
    watcher = bus.attach("watcher", heard.append, listen_only=True)
    port.send(0x123)
    bus.advance(MILLISECOND)
    assert bus.statistics.errors[BusError.ACK_ERROR] > 0
    assert not watcher.send(0x200)
    assert heard == []


def test_a_bit_error_costs_the_sender_8_and_the_listener_1_and_success_gives_1_back():
    bus, a, b, heard = two_nodes(Destroy(error=BusError.BIT_ERROR, bit=30, count=1))
    a.send(0x100, b"data")
    bus.advance(50_000)
    assert (a.counters.tec, b.counters.rec) == (8, 1)
    bus.advance(MILLISECOND)
    assert [frame.data for frame in heard["b"] if not frame.arbitration_id & ERROR] == [b"data"]
    assert (a.counters.tec, b.counters.rec) == (7, 0)


def test_a_crc_error_costs_who_sees_it_first_9_and_the_others_1():
    bus, a, b, _ = two_nodes(Destroy(error=BusError.CRC_ERROR, receiver="b", count=1))
    c = bus.attach("c", quiet)
    a.send(0x100, b"data")
    done_ns = 1000 * frame_bits(0x100, b"data")
    bus.advance(done_ns)
    assert (a.counters.tec, b.counters.rec, c.counters.rec) == (8, 9, 1)
    bus.advance(MILLISECOND)
    assert (a.counters.tec, b.counters.rec, c.counters.rec) == (7, 8, 0)


def counters_after(error, *, receiver=None, passive=(), ack_less=()):
    """TEC of the sender `a` and REC of `b` and `c`, as changed by one destroyed frame."""
    faults = [AckLess(node=name) for name in ack_less]
    bus, a, b, _ = two_nodes(Destroy(error=error, receiver=receiver, count=1), *faults)
    c = bus.attach("c", quiet)
    for port in (a, b, c):
        if port.name in passive:
            port.counters.tec = 130
    bus._state.rewire()
    a.send(0x100, b"data")
    bus.advance(1000 * (frame_bits(0x100, b"data") + 10))
    assert bus.statistics.errors == {error: 1}
    return a.counters.tec - (130 if "a" in passive else 0), b.counters.rec, c.counters.rec


CRC, FORM, STUFF = BusError.CRC_ERROR, BusError.FORM_ERROR, BusError.BIT_STUFFING_ERROR


def test_a_crc_error_that_all_see_costs_each_receiver_1():
    # Nobody acknowledges, so the flag of the transmitter begins a bit before those of the
    # receivers, and none of these sees a dominant bit after its own (rules a and c).
    assert counters_after(CRC) == (8, 1, 1)
    assert counters_after(CRC, passive="a") == (8, 1, 1)


def test_who_alone_could_acknowledge_and_sees_a_crc_error_pays_1():
    assert counters_after(CRC, receiver="b", ack_less="c") == (8, 1, 1)


@pytest.mark.parametrize("error", [FORM, STUFF])
def test_an_error_that_all_receivers_see_before_the_transmitter_costs_them_9(error):
    # Its flag begins after theirs: each sees a dominant bit after its own (rule b).
    assert counters_after(error) == (8, 9, 9)


@pytest.mark.parametrize("error", [FORM, STUFF])
def test_a_passive_transmitter_adds_no_dominant_bit_to_the_flags_of_the_receivers(error):
    assert counters_after(error, passive="a") == (8, 1, 1)


def test_who_sees_an_error_first_pays_9_only_where_somebody_answers_with_an_active_flag():
    assert counters_after(CRC, receiver="b") == (8, 9, 1)
    assert counters_after(CRC, receiver="b", passive="a") == (8, 9, 1)
    assert counters_after(CRC, receiver="b", passive="c") == (8, 9, 1)
    assert counters_after(CRC, receiver="b", passive="ac") == (8, 1, 1)


def test_a_crc_error_that_all_see_takes_the_bits_of_its_error_frame():
    """Flags, 8 bits of delimiter, 3 of intermission; then the frame again."""
    bus, a, _b, heard = two_nodes(Destroy(error=CRC, count=1))
    a.send(0x100, b"data")
    bus.advance(MILLISECOND)
    (frame,) = (frame for frame in heard["b"] if not frame.arbitration_id & ERROR)
    bits = frame_bits(0x100, b"data")
    # The transmitter's flag begins 8 bits before the end of the frame, the receivers' a bit later.
    assert frame.stamp_ns == 1000 * ((bits - 8 + 7) + 8 + 3 + bits)


def test_an_error_passive_listener_cannot_destroy_a_frame_for_the_others():
    bus, a, b, heard = two_nodes(Destroy(error=BusError.CRC_ERROR, receiver="b", first=15))
    others = []
    bus.attach("c", others.append)
    b.counters.rec = 200
    bus._state.rewire()
    for number in range(16):
        b.counters.rec = 200
        a.send(0x100, bytes([number]))
        bus.advance(bus.now_ns + MILLISECOND)
    assert [frame.data[0] for frame in others] == list(range(16))
    assert [frame.data[0] for frame in heard["b"] if not frame.arbitration_id & ERROR] == list(
        range(15)
    )
    assert b.counters.rec == 201
    assert a.counters.tec == 0


def test_32_bit_errors_in_a_row_are_bus_off():
    bus, a, b, heard = two_nodes(Destroy(error=BusError.BIT_ERROR), restart_ms=None)
    a.send(0x100, b"data")
    a.send(0x101)
    bus.advance(100 * MILLISECOND)
    assert a.state is ErrorState.BUS_OFF
    assert bus.statistics.errors == {BusError.BIT_ERROR: 32}
    assert a.statistics.bus_offs == 1
    assert a.statistics.discarded == 2  # what was queued is not sent after the recovery
    assert not a.send(0x100)
    assert len(errors_of(heard["a"], "BUSOFF")) == 1
    assert b.state is ErrorState.ERROR_ACTIVE  # 32 receive errors


def test_the_way_to_bus_off_is_told_as_a_real_driver_tells_it():
    """As `tools/arm-guest` saw it: kvaser_pci of Debian 12's kernel, 6.1.0-57."""
    bus, a, _, heard = two_nodes(Destroy(error=BusError.BIT_ERROR, count=32), restart_ms=100)
    a.send(0x100, b"data")
    bus.advance(200 * MILLISECOND)
    states = LOSSES["CRTL"] | LOSSES["BUSOFF"] | LOSSES["RESTARTED"]
    told = [
        (f"{frame.arbitration_id & (ERROR | states | COUNTERS):X}", frame.data[1], frame.data[6:])
        for frame in heard["a"]
        if frame.arbitration_id & states
    ]
    assert told == [
        ("20000204", 0x08, bytes((96, 0))),
        ("20000204", 0x20, bytes((128, 0))),
        ("20000040", 0x00, bytes(2)),
        ("20000100", 0x00, bytes(2)),
    ]


def bus_off_time(heard):
    return errors_of(heard, "BUSOFF")[0].stamp_ns


def test_recovery_takes_128_times_11_recessive_bits_on_an_idle_bus():
    bus, a, _, heard = two_nodes(Destroy(error=BusError.BIT_ERROR, count=32), restart_ms=5)
    a.send(0x100, b"data")
    bus.advance(100 * MILLISECOND)
    restarted = errors_of(heard["a"], "RESTARTED")
    begin = bus_off_time(heard["a"]) + 5 * MILLISECOND
    assert [frame.stamp_ns for frame in restarted] == [begin + 128 * 11 * 1000]
    assert (a.state, a.counters.tec) == (ErrorState.ERROR_ACTIVE, 0)
    a.send(0x105)
    bus.advance(200 * MILLISECOND)
    assert a.statistics.sent == 1


def test_recovery_on_a_full_bus_counts_one_sequence_a_frame():
    bus, a, b, heard = two_nodes(
        Destroy(error=BusError.BIT_ERROR, node="a", count=32), restart_ms=0
    )
    bus.attach("c", quiet)
    a.send(0x100, b"data")
    while not errors_of(heard["a"], "RESTARTED"):
        if b.room:
            b.send(0x200, b"\x55" * 8)
        bus.advance(bus.now_ns + 20_000)
    period = 1000 * (frame_bits(0x200, b"\x55" * 8) + 3)
    took = errors_of(heard["a"], "RESTARTED")[0].stamp_ns - bus_off_time(heard["a"])
    assert 126 * period <= took <= 131 * period


def test_without_restart_time_only_a_restart_by_hand_recovers():
    bus, a, _, _ = two_nodes(Destroy(error=BusError.BIT_ERROR, count=32), restart_ms=None)
    a.send(0x100)
    bus.advance(1000 * MILLISECOND)
    assert a.state is ErrorState.BUS_OFF
    a.restart()
    a.restart()
    bus.advance(1003 * MILLISECOND)
    assert a.state is ErrorState.ERROR_ACTIVE


def test_an_error_passive_sender_lets_the_others_go_first():
    bus, a, b, _ = two_nodes()
    order = []
    bus.attach("c", order.append)
    a.counters.tec = 150
    bus._state.rewire()
    a.send(0x100)
    a.send(0x101)
    bus.advance(frame_bits(0x100, b"") * 1000)
    bus.advance(bus.now_ns + 5_000)  # intermission is over, suspend transmission is not
    b.send(0x700)
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in order] == [0x100, 0x700, 0x101]
    gap_ns = order[2].stamp_ns - order[1].stamp_ns
    assert gap_ns == 1000 * (3 + frame_bits(0x101, b""))


def test_two_nodes_with_one_id_destroy_each_other_until_they_are_passive():
    bus, a, b, _ = two_nodes()
    received = []
    bus.attach("c", received.append)
    a.send(0x100, b"a")
    b.send(0x100, b"b")
    bus.advance(10 * MILLISECOND)
    assert bus.statistics.errors == {BusError.BIT_ERROR: 16}
    assert [frame.data for frame in received] == [b"a", b"b"]  # 'a' has the dominant bit
    assert (a.counters.tec, b.counters.tec) == (127, 135)


def test_a_dominant_bus_makes_the_sender_bus_off_and_the_listener_passive():
    bus, a, b, heard = two_nodes(Dominant(start_ns=20_000, end_ns=2 * MILLISECOND), restart_ms=None)
    a.send(0x100, b"data")
    bus.advance(2 * MILLISECOND)
    assert a.state is ErrorState.BUS_OFF
    assert b.state is ErrorState.ERROR_PASSIVE
    took_ns = bus_off_time(heard["a"]) - 20_000
    assert took_ns == 1000 * (6 + 14 + 8 * 30)  # flag at the sixth bit, then rule f 31 times


def test_traffic_goes_on_after_a_dominant_bus():
    bus, a, b, heard = two_nodes(Dominant(start_ns=20_000, end_ns=100_000))
    a.send(0x100, b"data")
    b.send(0x101, b"more")
    bus.advance(5 * MILLISECOND)
    assert a.statistics.sent == b.statistics.sent == 1
    first = next(frame for frame in heard["b"] if not frame.arbitration_id & ERROR)
    assert first.stamp_ns >= 100_000 + 11_000 + 1000 * frame_bits(0x100, b"data")


def test_a_cut_off_sender_is_alone_and_goes_on_when_the_wire_is_whole():
    bus, a, b, heard = two_nodes(Cut(node="a", start_ns=MILLISECOND, end_ns=50 * MILLISECOND))
    bus.attach("c", quiet)
    bus.advance(2 * MILLISECOND)
    a.send(0x100, b"late")
    b.send(0x200, b"others")
    bus.advance(40 * MILLISECOND)
    assert (a.counters.tec, b.statistics.sent) == (128, 1)
    assert heard["b"] == []
    assert not [frame for frame in heard["a"] if not frame.arbitration_id & ERROR]
    bus.advance(60 * MILLISECOND)
    assert [frame.data for frame in heard["b"]] == [b"late"]
    assert heard["b"][0].stamp_ns >= 50 * MILLISECOND + 11_000


def test_a_wire_cut_under_a_frame_destroys_it():
    bus, a, b, _heard = two_nodes(Cut(node="a", start_ns=30_000, end_ns=5 * MILLISECOND))
    c = bus.attach("c", quiet)
    a.send(0x100, bytes(8))
    bus.advance(MILLISECOND)
    assert b.counters.rec == c.counters.rec == 1
    assert a.pending == 1
    bus.advance(10 * MILLISECOND)
    assert a.statistics.sent == 1


def test_a_bus_cut_everywhere_leaves_everybody_alone():
    bus, a, b, _ = two_nodes(Cut(end_ns=10 * MILLISECOND))
    a.send(0x100)
    b.send(0x101)
    bus.advance(10 * MILLISECOND)
    assert a.counters.tec == b.counters.tec == 128
    bus.advance(11 * MILLISECOND)
    assert a.statistics.sent == b.statistics.sent == 1


def test_a_node_that_boots_on_a_cut_wire_sends_alone_whatever_it_sent_before():
    bus, a, _, _ = two_nodes(Cut(end_ns=10 * MILLISECOND))
    a.send(0x100)
    bus.advance(10_000)
    a.detach()
    a = bus.attach("a", quiet)
    a.send(0x100)
    attempt_ns = 1000 * (frame_bits(0x100, b"") - 8 + 6 + 8 + 3)
    bus.advance(bus.now_ns + attempt_ns - 1)
    assert a.counters.tec == 0
    bus.advance(bus.now_ns + 1)
    assert a.counters.tec == 8


def test_a_listener_without_acknowledge_still_hears_what_another_acknowledges():
    bus, a, _b, heard = two_nodes(AckLess(node="b"))
    a.send(0x100)
    bus.advance(MILLISECOND)
    assert a.statistics.sent == 0
    assert bus.statistics.errors[BusError.ACK_ERROR] > 0
    bus.attach("c", quiet)
    bus.advance(2 * MILLISECOND)
    assert a.statistics.sent == 1
    assert [frame.arbitration_id for frame in heard["b"] if frame.arbitration_id < ERROR] == [0x100]


def test_an_unanswered_node_stays_so_whoever_comes_and_hears_and_acknowledges_the_others():
    bus, a, b, heard = two_nodes(Unanswered(node="a", end_ns=5 * MILLISECOND))
    a.send(0x100)
    b.send(0x101)
    bus.advance(MILLISECOND)
    c = bus.attach("c", quiet)
    c.send(0x102)
    bus.advance(5 * MILLISECOND - 1)
    assert (a.statistics.sent, b.statistics.sent, c.statistics.sent) == (0, 1, 1)
    assert a.counters.tec == 128
    bus.advance(6 * MILLISECOND)
    assert a.statistics.sent == 1
    assert [frame.arbitration_id for frame in heard["b"] if frame.arbitration_id == 0x100]


def test_error_messages_have_the_layout_of_linux():
    bus, a, _b, heard = two_nodes(Destroy(error=BusError.BIT_ERROR, bit=30, count=1))
    a.send(0x100, b"data")
    bus.advance(MILLISECOND)
    (sent,), (seen,) = (errors_of(heard[name], "PROT") for name in "ab")
    assert sent.arbitration_id == 0x20000000 | 0x080 | 0x008 | 0x200  # BUSERROR, PROT, CNT
    assert list(sent.data) == [0, 0, 0x80 | 0x01, 0, 0, 0, 8, 0]  # TX, BIT; TEC 8
    assert list(seen.data) == [0, 0, 0x04, 0, 0, 0, 0, 1]  # STUFF; REC 1
    assert sent.stamp_ns == seen.stamp_ns == 30_000


def test_who_did_not_ask_gets_no_error_messages():
    bus = Bus(faults=FaultPlan((Destroy(count=3),)))
    heard = []
    a, _ = bus.attach("a", heard.append), bus.attach("b", heard.append)
    a.send(0x100)
    bus.advance(MILLISECOND)
    assert [frame.arbitration_id for frame in heard] == [0x100]


steps = st.lists(
    st.sampled_from(
        [
            "transmit_error",
            "acknowledge_error",
            "receive_error",
            "receive_error_first",
            "transmitted",
            "received",
        ]
    ),
    max_size=200,
)


@given(steps)
def test_counters_stay_in_range_and_the_state_follows_the_worse_one(names):
    counters = ErrorCounters()
    for name in names:
        if counters.bus_off:
            break
        getattr(counters, name)()
    assert 0 <= counters.tec <= 255
    assert 0 <= counters.rec <= 255
    worst = max(counters.tec, counters.rec)
    if counters.bus_off:
        assert counters.state is ErrorState.BUS_OFF
    else:
        assert counters.state == (worst >= 96) + (worst >= 128)


def test_a_passive_receiver_comes_back_to_127_with_one_good_frame():
    counters = ErrorCounters()
    counters.rec = 250
    counters.received()
    assert counters.rec == 127


def test_acknowledge_errors_alone_never_end_in_bus_off():
    counters = ErrorCounters()
    for _ in range(1000):
        counters.acknowledge_error()
    assert (counters.tec, counters.bus_off) == (128, False)


@pytest.mark.parametrize("kind", [BusError.CRC_ERROR, BusError.FORM_ERROR])
def test_destroyed_frames_are_repeated_until_they_get_through(kind):
    bus, a, _, heard = two_nodes(Destroy(error=kind, count=5))
    a.send(0x100, b"data")
    bus.advance(10 * MILLISECOND)
    assert bus.statistics.errors == {kind: 5}
    assert [frame.data for frame in heard["b"] if frame.arbitration_id < ERROR] == [b"data"]
    assert bus.statistics.ids[0x100].errors == 5
