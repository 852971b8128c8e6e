"""CAN FD on the simulated bus: who sends, who hears, who objects, and how long it takes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bus.bits import arbitration_key, frame_bits
from firmware_sim.bus.core import Bus
from firmware_sim.bus.errors import BusError, ErrorState
from firmware_sim.bus.faults import AckLess, Babble, Corrupt, Destroy
from firmware_sim.bus.fd_bits import frame_bit_sequence, frame_length
from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    ERROR_STATE_FLAG,
    EXTENDED_FLAG,
    FD_FLAG,
    FD_LENGTHS,
    REMOTE_FLAG,
    Filter,
)
from firmware_sim.bus.state import FdSupport

MILLISECOND = 1_000_000
BIT_NS, DATA_BIT_NS = 1_000, 200
FAST = FD_FLAG | BIT_RATE_SWITCH_FLAG

ids = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF).map(lambda plain: plain | EXTENDED_FLAG),
)
fd_frames = st.tuples(
    st.builds(lambda plain, flags: plain | flags, ids, st.sampled_from([FD_FLAG, FAST])),
    st.sampled_from(FD_LENGTHS).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
)
classic_frames = st.tuples(ids, st.binary(max_size=8))


def fd_bus(**options):
    return Bus(data_bitrate=5_000_000, **options)


def attach(bus, name, fd=FdSupport.ENABLED, **options):
    received = []
    return bus.attach(name, received.append, fd=fd, **options), received


def heard(received):
    return [(frame.arbitration_id, frame.data) for frame in received]


@given(st.lists(st.one_of(fd_frames, classic_frames), min_size=1, max_size=12))
def test_frames_of_both_formats_arrive_whole_after_the_time_of_their_bits(frames):
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "listener")
    for frame in frames:
        assert sender.send(*frame)
    bus.advance(100 * MILLISECOND)
    assert heard(received) == frames
    now_ns = 0
    for (can_id, data), frame in zip(frames, received, strict=True):
        length = frame_length(can_id, data)
        slow_bits = len(frame_bit_sequence(can_id, data)) - length.fast_bits
        now_ns += slow_bits * BIT_NS + length.fast_bits * DATA_BIT_NS
        assert frame.stamp_ns == now_ns
        now_ns += 3 * BIT_NS


def test_sixty_four_bytes_take_the_time_of_a_sum_by_hand():
    """No dynamic stuff bit: 17 bits to BRS, then 5, 512 and 33 fast ones, then 9."""
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "listener")
    sender.send(0x555 | FAST, b"\x55" * 64)
    sender.send(0x555 | FD_FLAG, b"\x55" * 64)
    bus.advance(10 * MILLISECOND)
    fast_ns = (17 + 9) * BIT_NS + (5 + 512 + 33) * DATA_BIT_NS
    assert received[0].stamp_ns == fast_ns == 136_000
    assert received[1].stamp_ns == fast_ns + 3 * BIT_NS + (17 + 5 + 512 + 33 + 9) * BIT_NS


@given(st.lists(st.one_of(fd_frames, classic_frames), min_size=2, max_size=8), st.randoms())
def test_frames_offered_together_come_in_the_order_of_their_arbitration_fields(frames, random):
    unique = {arbitration_key(can_id): (can_id, data) for can_id, data in frames}
    bus = fd_bus()
    _, received = attach(bus, "listener")
    ports = [attach(bus, f"node{index}")[0] for index in range(len(unique))]
    random.shuffle(ports)
    for port, frame in zip(ports, unique.values(), strict=True):
        port.send(*frame)
    bus.advance(100 * MILLISECOND)
    assert heard(received) == [unique[key] for key in sorted(unique)]


def test_the_same_identifier_in_both_formats_at_once_is_an_error_at_the_format_bit():
    bus = fd_bus()
    _, received = attach(bus, "listener")
    errors = []
    bus.tap(lambda frame: errors.append(frame) if frame.arbitration_id & 0x20000000 else None)
    classic, _ = attach(bus, "classic")
    fast, _ = attach(bus, "fast")
    classic.send(0x555)
    fast.send(0x555 | FAST)
    bus.advance(20_000)
    # SOF, identifier, RTR and IDE are 14 bits; the 15th is FDF, recessive against r0.
    assert [error.stamp_ns for error in errors] == [15 * BIT_NS]
    assert (classic.counters.tec, fast.counters.tec) == (8, 8)
    assert received == []


def test_a_filter_of_plain_identifiers_tells_the_formats_apart():
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, classic = attach(bus, "classic", accept=[0x181])
    _, fast = attach(bus, "fast", accept=[0x181 | FD_FLAG])
    _, linux = attach(bus, "linux", accept=[Filter(0x181, 0xC00007FF)])
    frames = [(0x181, b"1"), (0x181 | FD_FLAG, b"2"), (0x181 | FAST, b"3")]
    for frame in [*frames, (0x181 | EXTENDED_FLAG | FAST, b"4"), (0x181 | REMOTE_FLAG, b"")]:
        sender.send(*frame)
    bus.advance(10 * MILLISECOND)
    assert heard(classic) == frames[:1]
    assert heard(fast) == frames[1:]
    assert heard(linux) == frames


def test_a_tolerant_controller_takes_no_part_in_frames_of_can_fd():
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "fd")
    tolerant, ignored = attach(bus, "tolerant", FdSupport.TOLERANT)
    tolerant.counters.rec = 5
    bus.inject(AckLess(node="tolerant", end_ns=1))  # makes the bus look at the counters
    sender.send(0x100 | FAST, bytes(64))
    bus.advance(MILLISECOND)
    assert len(received) == 1
    assert ignored == []
    assert tolerant.counters.rec == 5
    sender.send(0x100, b"x")
    bus.advance(2 * MILLISECOND)
    assert heard(ignored) == [(0x100, b"x")]
    assert tolerant.counters.rec == 4


def test_a_tolerant_controller_does_not_acknowledge_frames_of_can_fd():
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, ignored = attach(bus, "tolerant", FdSupport.TOLERANT)
    sender.send(0x100 | FAST, bytes(8))
    bus.advance(10 * MILLISECOND)
    assert set(bus.statistics.errors) == {BusError.ACK_ERROR}
    assert sender.state is ErrorState.ERROR_PASSIVE
    assert ignored == []


def test_a_classic_controller_destroys_frames_of_can_fd_until_it_is_error_passive():
    """The trap of a mixed bus. The objector has REC + 9 an error, so it gives in after 15 of them,
    before the transmitter is error-passive; every classic frame lets it recover and object again.
    """
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "fd")
    classic, heard_by_classic = attach(bus, "classic", FdSupport.INTOLERANT)
    sender.send(0x555 | FAST, bytes(8))
    first_error_ns = (17 + 6) * BIT_NS - 6 * BIT_NS + 6 * DATA_BIT_NS
    bus.advance(first_error_ns - 1)
    assert not bus.statistics.errors
    bus.advance(first_error_ns)
    assert bus.statistics.errors == {BusError.BIT_STUFFING_ERROR: 1}
    assert (sender.counters.tec, classic.counters.rec) == (8, 9)
    bus.advance(10 * MILLISECOND)
    assert bus.statistics.errors == {BusError.BIT_STUFFING_ERROR: 15}
    assert len(received) == 1
    assert heard_by_classic == []
    assert classic.state is ErrorState.ERROR_PASSIVE
    assert sender.counters.tec == 15 * 8 - 1
    sender.send(0x100, b"")
    bus.advance(11 * MILLISECOND)
    assert classic.counters.rec == 127
    sender.send(0x555 | FAST, bytes(8))
    bus.advance(12 * MILLISECOND)
    assert bus.statistics.errors == {BusError.BIT_STUFFING_ERROR: 16}


def test_a_classic_controller_that_only_listens_disturbs_nothing():
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "fd")
    attach(bus, "logger", FdSupport.INTOLERANT, listen_only=True)
    sender.send(0x100 | FAST, bytes(64))
    bus.advance(MILLISECOND)
    assert len(received) == 1
    assert not bus.statistics.errors


def test_an_error_passive_transmitter_says_so_in_its_frames():
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "listener", accept=[0x100 | FD_FLAG])
    bus.inject(Destroy(node="sender", error=BusError.BIT_ERROR, count=17))
    sender.send(0x100 | FAST, bytes(2))
    bus.advance(20 * MILLISECOND)
    assert heard(received) == [(0x100 | FAST | ERROR_STATE_FLAG, bytes(2))]
    for _ in range(20):
        sender.send(0x7FF, b"")
    sender.send(0x100 | FAST, bytes(2))
    bus.advance(40 * MILLISECOND)
    assert received[-1].arbitration_id == 0x100 | FAST


def test_a_lone_node_waits_error_passive_with_a_frame_of_can_fd_as_with_any():
    bus = fd_bus()
    sender, _ = attach(bus, "sender")
    sender.send(0x100 | FAST, bytes(8))
    bus.advance(3_600_000_000_000)
    assert sender.counters.tec == 128
    assert bus.next_event_ns is None
    _, received = attach(bus, "late")
    bus.advance(bus.now_ns + MILLISECOND)
    assert heard(received) == [(0x100 | FAST | ERROR_STATE_FLAG, bytes(8))]


def test_faults_strike_frames_of_can_fd_by_their_identifier_with_its_flags():
    bus = fd_bus(seed=3)
    sender, _ = attach(bus, "sender")
    _, received = attach(bus, "listener")
    bus.inject(Corrupt(arbitration_id=0x100 | FAST, xor=bytes(63) + b"\xff"))
    bus.inject(Destroy(arbitration_id=0x100 | FAST, error=BusError.CRC_ERROR, count=1))
    sender.send(0x100 | FAST, bytes(64))
    sender.send(0x100 | FD_FLAG, bytes(64))
    bus.advance(10 * MILLISECOND)
    assert heard(received) == [
        (0x100 | FAST, bytes(63) + b"\xff"),
        (0x100 | FD_FLAG, bytes(64)),
    ]
    assert bus.statistics.errors == {BusError.CRC_ERROR: 1}


@pytest.mark.parametrize(
    ("can_id", "size", "said"),
    [
        (0x100 | FD_FLAG, 9, "9 data bytes, allowed: 0 to 8, 12"),
        (0x100 | FD_FLAG, 65, "65 data bytes"),
        (0x100 | FD_FLAG | REMOTE_FLAG, 0, "no remote requests"),
        (0x100 | BIT_RATE_SWITCH_FLAG, 0, "need FD_FLAG"),
        (0x100, 12, "12 data bytes, at most 8 without FD_FLAG"),
        (0x800 | FD_FLAG, 0, "allowed: 0..7FF"),
    ],
)
def test_what_is_no_frame_of_can_fd_is_refused(can_id, size, said):
    port, _ = attach(fd_bus(), "a")
    with pytest.raises(ValueError, match=said):
        port.send(can_id, bytes(size))


def test_a_classic_bus_and_a_classic_controller_send_no_can_fd():
    port, _ = attach(Bus(), "a")
    with pytest.raises(ValueError, match="no data bit rate"):
        port.send(0x100 | FD_FLAG)
    with pytest.raises(ValueError, match="no data bit rate"):
        Bus().inject(Babble(node="a", arbitration_id=0x100 | FD_FLAG))
    port, _ = attach(fd_bus(), "a", FdSupport.TOLERANT)
    with pytest.raises(ValueError, match="'a' knows no CAN FD"):
        port.send(0x100 | FD_FLAG)


def test_a_data_bit_rate_below_the_bit_rate_is_refused():
    with pytest.raises(ValueError, match="data_bitrate 500000: at least the bitrate, 1000000"):
        Bus(data_bitrate=500_000)


def test_the_load_counts_the_time_and_not_the_bits():
    bus = fd_bus(load_window_ns=100 * MILLISECOND)
    sender, _ = attach(bus, "sender")
    attach(bus, "listener")
    for _ in range(100):
        sender.send(0x555 | FAST, b"\x55" * 64)
        bus.advance(bus.now_ns + MILLISECOND)
    assert bus.load() == pytest.approx(0.139, rel=0.06)
    counted = bus.statistics.ids[0x555 | FAST]
    assert (counted.frames, counted.bits) == (100, 100 * (17 + 5 + 512 + 33 + 9 + 3))


def test_classic_traffic_is_the_same_on_a_bus_that_carries_can_fd():
    def run(bus):
        received = []
        bus.attach("listener", received.append)
        ports = [bus.attach(f"n{index}", lambda frame: None) for index in range(3)]
        bus.inject(Destroy(error=BusError.CRC_ERROR, probability=0.2))
        for step in range(200):
            ports[step % 3].send(0x100 + step % 7, bytes([step % 256]) * (step % 9))
            bus.advance(bus.now_ns + 200_000)
        return received

    assert run(fd_bus(seed=1)) == run(Bus(seed=1))
    assert frame_length(0x123, b"1").bits == frame_bits(0x123, b"1")
