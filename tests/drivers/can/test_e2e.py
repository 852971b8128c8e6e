from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.drivers.can.codec import compile_encoder
from robotctl.drivers.can.dbc import load_dbc
from robotctl.drivers.can.e2e import (
    COUNTER_MODULUS,
    SILENCE_PERIODS,
    AliveCounter,
    E2eCounters,
    E2eReceiver,
    E2eStatus,
)

MESSAGE = load_dbc(Path(__file__).parents[3] / "configs" / "robot.dbc").message("WheelFeedback")
ENCODE = compile_encoder(MESSAGE, ("Counter", "Count1"))
PERIOD_NS = 5_000_000
TIMEOUT_NS = SILENCE_PERIODS * PERIOD_NS
STEP_NS = 5_000_000


class Link:
    def __init__(self):
        self.counters = E2eCounters()
        self.surplus_ns = []
        self.receiver = E2eReceiver(
            MESSAGE, PERIOD_NS, self.counters, on_surplus=self.surplus_ns.append
        )
        self.now_ns = 0

    def take(self, counter, wait_ns=STEP_NS, data=None):
        self.now_ns += wait_ns
        used = self.receiver.accept(ENCODE(counter, 7) if data is None else data, self.now_ns)
        assert used == (self.receiver.status in (E2eStatus.OK, E2eStatus.OK_SOME_LOST))
        return self.receiver.status

    def counts(self):
        c = self.counters
        return c.crc_rejects, c.counter_rejects, c.lost


@pytest.fixture
def link():
    link = Link()
    assert link.take(5) is E2eStatus.INITIAL
    return link


def test_the_sender_counts_from_0_to_14_and_begins_again():
    counter = AliveCounter()
    seen = []
    for _ in range(31):
        seen.append(counter.value)
        counter.advance()
    assert seen == [*range(15), *range(15), 0]


def test_a_message_without_protection_is_refused():
    with pytest.raises(ValueError, match=r"^MotorStatus has no E2E protection$"):
        E2eReceiver(replace(MESSAGE, name="MotorStatus", protection=None), 1, E2eCounters())


def test_before_the_first_frame_the_status_is_initial():
    assert E2eReceiver(MESSAGE, PERIOD_NS, E2eCounters()).status is E2eStatus.INITIAL


def test_every_reject_and_every_loss_is_counted_for_ever(link):
    for number in range(1, 4):
        assert link.take(None, data=b"") is E2eStatus.WRONG_LENGTH
        assert link.take(None, data=bytes(8)) is E2eStatus.WRONG_CRC
        counter = (5 + 8 * (number - 1)) % 15
        assert link.take((counter + 3) % 15) is E2eStatus.OK_SOME_LOST
        assert link.take((counter + 3) % 15) is E2eStatus.REPEATED
        assert link.take((counter + 8) % 15) is E2eStatus.WRONG_SEQUENCE
        assert link.counts() == (2 * number, 2 * number, 2 * number)


def test_the_first_frame_only_sets_the_reference(link):
    assert link.take(6) is E2eStatus.OK
    assert link.counts() == (0, 0, 0)


@pytest.mark.parametrize("first", range(15))
@pytest.mark.parametrize("delta", range(15))
def test_each_step_of_the_counter_is_judged_as_profile_1_says(first, delta):
    link = Link()
    link.take(first)
    status = link.take((first + delta) % 15)
    if delta == 0:
        assert (status, link.counts()) == (E2eStatus.REPEATED, (0, 1, 0))
    elif delta == 1:
        assert (status, link.counts()) == (E2eStatus.OK, (0, 0, 0))
    elif delta <= 3:
        assert (status, link.counts()) == (E2eStatus.OK_SOME_LOST, (0, 0, delta - 1))
    else:
        assert (status, link.counts()) == (E2eStatus.WRONG_SEQUENCE, (0, 1, 0))
    assert link.take((first + delta + 1) % 15) is E2eStatus.OK


def test_a_bad_crc_is_dropped_and_leaves_the_reference(link):
    bad = bytearray(ENCODE(6, 7))
    bad[4] ^= 0x10
    assert link.take(None, data=bytes(bad)) is E2eStatus.WRONG_CRC
    assert link.take(6) is E2eStatus.OK
    assert link.counts() == (1, 0, 0)


@pytest.mark.parametrize("length", [0, 1, 7])
def test_a_wrong_length_is_dropped_and_counted_with_the_crc(link, length):
    assert link.take(None, data=ENCODE(6, 7)[:length]) is E2eStatus.WRONG_LENGTH
    assert link.take(6) is E2eStatus.OK
    assert link.counts() == (1, 0, 0)


def crc_bit_by_bit(data_id, payload):
    crc = 0
    for byte in (data_id & 0xFF, data_id >> 8, *payload):
        for bit in range(7, -1, -1):
            feedback = crc >> 7 ^ byte >> bit & 1
            crc = (crc << 1 & 0xFF) ^ (0x1D if feedback else 0)
    return crc


def test_counter_15_is_dropped_even_with_a_good_crc(link):
    payload = bytearray(ENCODE(14, 7)[1:])
    assert crc_bit_by_bit(MESSAGE.protection.data_id, payload) == ENCODE(14, 7)[0]
    payload[0] |= 0x0F
    crc = crc_bit_by_bit(MESSAGE.protection.data_id, payload)
    assert link.take(None, data=bytes([crc, *payload])) is E2eStatus.WRONG_SEQUENCE
    assert link.take(None, data=bytes([crc, *payload])) is E2eStatus.WRONG_SEQUENCE
    assert link.take(6) is E2eStatus.OK
    assert link.counts() == (0, 2, 0)


def test_after_a_silence_the_next_frame_only_sets_the_reference(link):
    assert link.take(6, wait_ns=TIMEOUT_NS) is E2eStatus.OK
    assert link.take(7, wait_ns=TIMEOUT_NS + 1) is E2eStatus.INITIAL
    assert link.take(8) is E2eStatus.OK
    assert link.counts() == (0, 0, 0)


def test_after_a_reset_the_next_frame_only_sets_the_reference(link):
    link.receiver.reset()
    assert link.take(0) is E2eStatus.INITIAL
    assert link.counts() == (0, 0, 0)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.sampled_from(["send", "lose", "repeat", "corrupt"]), max_size=60))
def test_no_frame_is_used_twice_and_none_that_was_corrupted(events):
    link = Link()
    sender = AliveCounter()
    last = None
    used = []
    number = 0
    for event in events:
        link.now_ns += STEP_NS
        frame = last
        if event != "repeat" or last is None:
            number += 1
            frame = (ENCODE(sender.value, number), number)
            sender.advance()
        last = frame
        data = frame[0]
        if event == "lose":
            continue
        if event == "corrupt":
            data = data[:2] + bytes([data[2] ^ 1]) + data[3:]
        if link.receiver.accept(data, link.now_ns):
            assert event != "corrupt"
            used.append(frame[1])
    assert used == sorted(set(used))


def frames_of(sender, first, count, period_ns, offset_ns=0):
    """Return times [ns] and frames of a sender whose counter begins at `first`."""
    return [
        (offset_ns + n * period_ns, ENCODE((first + n) % COUNTER_MODULUS, sender))
        for n in range(count)
    ]


def heard(*streams):
    """Return when surplus frames are counted [ns] of some streams on one bus."""
    link = Link()
    for time_ns, data in sorted(frame for stream in streams for frame in stream):
        link.receiver.accept(data, time_ns)
    return link.surplus_ns


counters, offsets_ns = st.integers(0, 14), st.integers(1, PERIOD_NS - 1)


@given(counters, counters, offsets_ns)
def test_a_second_sender_is_told_within_six_periods_whatever_its_counter(first, other, offset_ns):
    true = frames_of(1, first, 100, PERIOD_NS)
    begin_ns = 50 * PERIOD_NS + offset_ns
    surplus_ns = heard(true, frames_of(2, other, 50, PERIOD_NS, begin_ns))
    assert surplus_ns[0] - begin_ns < 6 * PERIOD_NS
    assert len(surplus_ns) > 30


@given(counters, st.lists(st.sampled_from(["sent", "lost", "twice", "late"]), max_size=200))
def test_frames_lost_repeated_or_out_of_order_are_of_one_sender(first, fates):
    """Late: behind the next one, as a device with several transmit buffers sends them."""
    stream = []
    late = None
    for (time_ns, data), fate in zip(
        frames_of(1, first, len(fates), PERIOD_NS), fates, strict=True
    ):
        stream += [] if fate in {"lost", "late"} else [(time_ns, data)]
        stream += [(time_ns + 1, data)] if fate == "twice" else []
        stream += [(time_ns + 2, late)] if late is not None else []
        late = data if fate == "late" else None
    assert heard(stream) == []


@given(counters, st.integers(1, 30), st.integers(1, 10))
def test_frames_that_waited_for_the_bus_are_of_one_sender(first, waited, gap):
    """A sender whose transmit buffers kept the last ones sends them at once, behind lost ones."""
    stream = frames_of(1, first, 100, PERIOD_NS)
    free_ns = stream[40 + gap][0]
    held = stream[40 : 40 + gap][-min(waited, 3) :]
    stream[40 : 40 + gap] = [(free_ns - 10 + n, data) for n, (_, data) in enumerate(held)]
    assert heard(stream) == []


@given(counters, st.lists(st.integers(0, 9 * PERIOD_NS // 5), min_size=100, max_size=100))
def test_a_host_whose_sync_is_late_makes_no_second_sender_of_frames_out_of_order(first, late_ns):
    true = [
        (time_ns + late, data)
        for (time_ns, data), late in zip(frames_of(1, first, 100, PERIOD_NS), late_ns, strict=True)
    ]
    swapped = []
    for (_, early), (time_ns, next_one) in zip(true[::2], true[1::2], strict=True):
        swapped += [(time_ns, next_one), (time_ns + 1, early)]
    assert heard(swapped) == []
