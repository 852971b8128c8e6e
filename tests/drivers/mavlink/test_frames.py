"""Finding frames in bytes: good frames between garbage, and no message from anything else.

pymavlink packs the frames; what is a valid frame is also decided here by a checksum written out.
"""

import time

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.frames import STALE_NS, FrameReader


def reader():
    return FrameReader(common.MAVLink(None, 1, 1))


def frame(message, seq=0, v1=False):
    codec = common.MAVLink(None, 255, 190)
    codec.seq = seq
    return message.pack(codec, force_mavlink1=v1)


def heartbeat(mode=0):
    return common.MAVLink_heartbeat_message(6, 8, 0, mode, 4, 3)


def arm():
    return common.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def crc_is_right(data):
    """X.25 as the MAVLink documentation gives it, bit by bit, over a whole MAVLink 2 frame."""
    number = int.from_bytes(data[7:10], "little")
    if number not in common.mavlink_map:
        return False
    end = 10 + data[1]
    crc = 0xFFFF
    for byte in (*data[1:end], common.mavlink_map[number].crc_extra):
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x8408 if crc & 1 else crc >> 1
    return crc == int.from_bytes(data[end : end + 2], "little")


def names(messages):
    return [message.get_type() for message in messages]


@pytest.mark.parametrize("v1", [False, True])
def test_frames_of_both_protocol_versions_are_read(v1):
    assert names(reader().feed(frame(arm(), v1=v1), 0)) == ["COMMAND_LONG"]


@given(st.lists(st.integers(1, 40), max_size=12))
def test_the_way_a_stream_is_cut_does_not_matter(cuts):
    stream = b"".join(frame(m, i) for i, m in enumerate([heartbeat(), arm(), heartbeat(3)]))
    under_test = reader()
    found = []
    for cut in cuts:
        found += under_test.feed(stream[:cut], 0)
        stream = stream[cut:]
    found += under_test.feed(stream, 0)
    assert names(found) == ["HEARTBEAT", "COMMAND_LONG", "HEARTBEAT"]
    assert under_test.bad_bytes == 0


GARBAGE = st.binary(max_size=60) | st.lists(
    st.sampled_from([0xFD, 0xFE, 0, 1, 9]), max_size=60
).map(bytes)


@given(GARBAGE, GARBAGE)
def test_good_frames_between_garbage_are_found_and_the_rest_is_counted(before, between):
    under_test = reader()
    stream = before + frame(arm()) + between + frame(heartbeat(9))
    found = under_test.feed(stream, 0) + under_test.expire(STALE_NS + 1)
    # Garbage may be a frame of an unknown message that ends where another begins.
    assume(not under_test.unknown)
    assert names(found) == ["COMMAND_LONG", "HEARTBEAT"]
    assert under_test.bad_bytes == len(before) + len(between)


@given(st.data())
def test_a_changed_frame_gives_no_message_unless_its_checksum_is_right(data):
    good = bytearray(frame(arm()))
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(good) - 1))
        good[position] ^= data.draw(st.integers(1, 255))
    under_test = reader()
    found = under_test.feed(bytes(good), 0) + under_test.expire(STALE_NS + 1)
    for message in found:
        assert crc_is_right(message.get_msgbuf())


@given(st.binary(max_size=2000))
def test_random_bytes_never_raise_and_every_byte_is_accounted_for(data):
    under_test = reader()
    found = under_test.feed(data, 0) + under_test.expire(STALE_NS + 1)
    read = sum(len(message.get_msgbuf()) for message in found)
    if not under_test.unknown:
        assert under_test.bad_bytes + read == len(data)


def test_half_a_frame_does_not_hold_back_a_command_for_longer_than_the_stale_time():
    under_test = reader()
    assert under_test.feed(b"\xfd\xff\x00" + frame(arm()), 0) == []
    assert under_test.expire(STALE_NS) == []
    assert names(under_test.expire(500_000_000)) == ["COMMAND_LONG"]
    assert under_test.bad_bytes == 3


def test_half_a_frame_that_is_completed_in_time_is_read():
    under_test = reader()
    data = frame(arm())
    assert under_test.feed(data[:9], 0) == []
    assert names(under_test.feed(data[9:], STALE_NS)) == ["COMMAND_LONG"]


def test_a_datagram_that_begins_with_a_frame_ends_a_frame_that_was_cut_off():
    under_test = reader()
    data = frame(arm())
    assert under_test.feed_datagram(data[:20], 0) == []
    assert names(under_test.feed_datagram(data, 1)) == ["COMMAND_LONG"]
    assert under_test.bad_bytes == 20


def test_a_frame_split_over_datagrams_is_put_together():
    under_test = reader()
    data = frame(arm())
    assert under_test.feed_datagram(data[:20], 0) == []
    assert names(under_test.feed_datagram(data[20:], 1)) == ["COMMAND_LONG"]


def test_messages_of_other_dialects_are_passed_over_whole():
    other = bytearray(frame(arm()))
    other[7:10] = (50_000).to_bytes(3, "little")
    under_test = reader()
    assert names(under_test.feed(bytes(other) + frame(heartbeat()), 0)) == ["HEARTBEAT"]
    assert (under_test.unknown, under_test.bad_bytes) == (1, 0)


def test_a_frame_with_an_unknown_incompatibility_flag_is_no_frame():
    other = bytearray(frame(heartbeat()))
    other[2] = 0x02
    assert reader().feed(bytes(other), 0) == []


def test_the_environment_cannot_switch_off_the_checksum():
    assert common.MAVLINK_IGNORE_CRC == 0


def test_an_endless_stream_that_always_ends_in_half_a_frame_is_not_kept():
    under_test = reader()
    data = frame(heartbeat())
    under_test.feed(data[:5], 0)
    for _ in range(1000):
        under_test.feed(data[5:] + data[:5], 0)
    assert len(under_test._buffer) == 5


@pytest.mark.parametrize(
    "flood",
    [b"\xfd" * 8192, b"\xfe" * 8192, b"\xfd\x00\x00" * 2730, frame(heartbeat())[:-1] * 390],
    ids=["v2 markers", "v1 markers", "empty headers", "frames without their last byte"],
)
def test_a_flood_of_garbage_costs_little_time(flood):
    under_test = reader()
    begin = time.process_time()
    for _ in range(4):
        under_test.feed(flood, 0)
    # 32 KiB; a quadratic search would take many seconds.
    assert time.process_time() - begin < 1.0
    assert under_test.bad_bytes + 12 * under_test.unknown > 30_000
