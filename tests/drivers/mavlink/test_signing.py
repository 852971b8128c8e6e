"""Signing, with pymavlink's own signing at the other end."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common as m

from robotctl.drivers.mavlink.base import Channel, LinkContext
from robotctl.drivers.mavlink.frames import FrameReader
from robotctl.drivers.mavlink.signing import LATEST, MINUTE, MOST_STREAMS, Signing
from robotctl.messages.mavlink_port import Peer

KEY, OTHER = bytes(range(32)), bytes(32)
EPOCH_NS = 1_420_070_400 * 10**9
NOW = 3 * 10**13
"""Time stamp of now: some nine years after 2015."""


class Wall:
    def __init__(self, stamp=NOW):
        self.stamp = stamp

    def __call__(self):
        return EPOCH_NS + self.stamp * 10_000


def station(key=KEY, stamp=NOW, system=255, component=190, link=0):
    """Return pymavlink as a ground station that signs."""
    codec = m.MAVLink(None, system, component)
    codec.robust_parsing = True
    codec.signing.secret_key = key
    codec.signing.sign_outgoing = True
    codec.signing.timestamp = stamp
    codec.signing.link_id = link
    return codec


def beat(codec):
    return bytes(m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(codec))


@pytest.fixture
def signing():
    return Signing(KEY, wall_ns=Wall())


def taken(signing, *frames, safe=False):
    reader = FrameReader(m.MAVLink(None), signing, safe=safe)
    return [each.get_type() for frame in frames for each in reader.feed(frame, 1)]


def test_robot_and_pymavlink_understand_each_other_both_ways(signing):
    robot = Channel(Peer(3, 0), LinkContext(None, [], 1, 1, signing))
    codec = station()
    for _ in range(3):
        frame = robot.encode(m.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3))
        assert codec.decode(bytearray(frame)).get_type() == "HEARTBEAT"
        assert taken(signing, beat(codec)) == ["HEARTBEAT"]
    assert m.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(station())[-13] == 0
    assert frame[-13] == 3
    with pytest.raises(m.MAVError):
        station(OTHER).decode(bytearray(frame))


def test_what_is_not_signed_or_old_or_of_another_key_is_refused(signing):
    codec = station()
    once = beat(codec)
    assert taken(signing, once) == ["HEARTBEAT"]
    before = signing.stamp
    plain = m.MAVLink(None, 255, 190)
    older = v1.MAVLink(None, 255, 190)
    for frame in (
        once,
        beat(plain),
        bytes(v1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(older)),
        beat(station(OTHER, 2 * NOW)),
        beat(station(stamp=NOW - MINUTE - 100, system=254)),
        beat(station(stamp=NOW - 5)),
    ):
        assert taken(signing, frame) == []
    assert signing.refused == 6
    assert signing.stamp == before
    assert taken(signing, beat(codec)) == ["HEARTBEAT"]
    assert taken(signing, beat(station(stamp=NOW - MINUTE + 100, system=254))) == ["HEARTBEAT"]


def test_the_time_stamps_of_a_sender_rise_whatever_link_its_frames_come_over(signing):
    first, second = (FrameReader(m.MAVLink(None), signing) for _ in range(2))
    codec = station()
    frames = [beat(codec) for _ in range(3)]
    assert len(first.feed(frames[1], 1)) == 1
    assert second.feed(frames[1] + frames[0], 1) == []
    assert len(second.feed(frames[2], 1)) == 1
    assert taken(signing, beat(station(link=7))) == ["HEARTBEAT"]  # counts by itself


def test_a_radio_and_a_first_key_over_a_safe_link_need_no_signature(signing):
    plain = m.MAVLink(None, 51, 68)
    radio = bytes(m.MAVLink_radio_status_message(1, 2, 90, 3, 4, 0, 0).pack(plain))
    setup = bytes(m.MAVLink_setup_signing_message(1, 1, list(OTHER), NOW).pack(plain))
    assert taken(signing, radio, setup, beat(plain)) == ["RADIO_STATUS"]
    assert taken(signing, radio, setup, beat(plain), safe=True) == ["RADIO_STATUS", "SETUP_SIGNING"]


def test_time_stamps_follow_the_clock_never_repeat_and_go_on_after_a_restart():
    wall = Wall()
    signing = Signing(KEY, wall_ns=wall)
    stamps = [signing.next_stamp() for _ in range(3)]
    assert stamps == [NOW, NOW + 1, NOW + 2]
    wall.stamp += 1000
    assert signing.next_stamp() == NOW + 1000
    wall.stamp = 0  # a robot without a clock that runs on
    again = Signing(KEY, signing.stamp + MINUTE, wall)
    assert again.next_stamp() == NOW + 1000 + MINUTE + 1
    assert taken(again, beat(station(stamp=2 * NOW))) == ["HEARTBEAT"]
    assert again.next_stamp() > 2 * NOW


def test_many_senders_take_no_memory_and_none_of_them_comes_twice(signing):
    frames = [beat(station(stamp=NOW + 10 * k, system=k % 250 + 1, link=k // 250))
              for k in range(3 * MOST_STREAMS)]  # fmt: skip
    assert len(taken(signing, *frames)) == len(frames)
    assert len(signing._last) == MOST_STREAMS
    assert taken(signing, *frames) == []
    assert taken(signing, *(beat(station(bytes([k] * 32), NOW + 10**6)) for k in range(99))) == []
    assert len(signing._last) == MOST_STREAMS


YEAR = 365 * 1440 * MINUTE


def restarted(signing, wall):
    """Return the signing of the next process."""
    return Signing(KEY, signing.stamp + MINUTE, wall, signing.memory)


@pytest.mark.parametrize("ahead", [2 * MINUTE, 30 * 1440 * MINUTE, 20 * YEAR])
def test_a_station_whose_clock_is_ahead_keeps_no_other_out_before_or_after_a_restart(ahead):
    wall = Wall()
    signing = Signing(KEY, wall_ns=wall)
    fast = station(stamp=NOW + ahead)
    recorded = beat(fast)
    assert taken(signing, recorded) == ["HEARTBEAT"]
    assert taken(signing, beat(station(system=254))) == ["HEARTBEAT"]
    wall.stamp += 10 * MINUTE
    again = restarted(signing, wall)
    assert taken(again, beat(station(stamp=wall.stamp, system=253))) == ["HEARTBEAT"]
    for each in (signing, again):
        assert taken(each, recorded) == []
    fast.signing.timestamp += 10 * MINUTE
    assert taken(again, beat(fast)) == ["HEARTBEAT"]
    assert again.next_stamp() < NOW + 12 * MINUTE
    assert signing.take_ahead() == {(255, 190, 0): ahead}
    assert signing.take_ahead() == {}


def test_what_was_recorded_before_a_restart_is_not_taken_after_it():
    """Also not of who was taken after the last save."""
    wall = Wall()
    signing = Signing(KEY, wall_ns=wall)
    known = station()
    first = beat(known)
    assert taken(signing, first) == ["HEARTBEAT"]
    saved = Signing(KEY, signing.stamp + MINUTE, wall, signing.memory)
    known.signing.timestamp += 1000
    later = beat(known)
    assert taken(signing, later) == ["HEARTBEAT"]
    assert taken(saved, first) == []
    wall.stamp += MINUTE + 2000
    assert taken(saved, later) == []
    known.signing.timestamp = wall.stamp
    assert taken(saved, beat(known)) == ["HEARTBEAT"]


def test_a_time_stamp_behind_which_none_is_newer_is_refused(signing):
    assert taken(signing, beat(station(stamp=2**48 - 2)), beat(station(stamp=LATEST))) == []
    assert taken(signing, beat(station())) == ["HEARTBEAT"]


def test_a_robot_without_a_clock_follows_the_stations_and_tells_late_ones_the_time():
    signing = Signing(KEY, wall_ns=Wall(stamp=0))
    assert taken(signing, beat(station())) == ["HEARTBEAT"]
    assert NOW <= signing.next_stamp() < NOW + 10
    late = station(stamp=NOW - 2 * MINUTE, system=254)
    channel = Channel(Peer(0, 1), LinkContext(None, [], 1, 1, signing))
    assert channel.reader.feed(beat(late), 1) == []
    assert channel.reader.late == 1
    late.decode(bytearray(channel.encode(m.MAVLink_system_time_message(0, 0))))
    assert len(channel.reader.feed(beat(late), 2)) == 1


@given(st.lists(st.integers(-2 * MINUTE, 2 * MINUTE), min_size=1, max_size=20))
def test_what_is_sent_to_a_station_is_new_to_it_whatever_its_clock_does(steps):
    """Stamps rise on each channel, and behind those of the station at its other end."""
    signing = Signing(KEY, wall_ns=Wall())
    channel = Channel(Peer(0, 0), LinkContext(None, [], 1, 1, signing))
    codec, before = station(), 0
    for step in steps:
        codec.signing.timestamp = max(codec.signing.timestamp + step, 0)
        frame = beat(codec)
        channel.reader.feed(frame, 1)
        answer = channel.encode(m.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3))
        stamp = int.from_bytes(answer[-12:-6], "little")
        assert stamp > before
        assert stamp > channel.reader.newest
        assert codec.decode(bytearray(answer)).get_type() == "HEARTBEAT"
        before = stamp


@settings(max_examples=150)
@given(st.integers(0, 8 * 34 - 1), st.integers(0, 2**32))
def test_a_frame_with_any_bits_changed_is_refused_and_the_next_is_taken(bit, seed):
    signing = Signing(KEY, wall_ns=Wall())
    codec, rng = station(), random.Random(seed)
    frame = bytearray(beat(codec))
    assert len(frame) == 34
    frame[bit // 8] ^= 1 << bit % 8
    for _ in range(rng.randint(0, 3)):
        frame[rng.randrange(34)] ^= rng.randint(0, 255)
    reader = FrameReader(m.MAVLink(None), signing)
    if bytes(frame) != beat(station()):
        assert reader.feed(bytes(frame), 1) == []
    assert signing.stamp == 0 or bytes(frame) == beat(station())
    late = reader.feed(beat(codec) + beat(codec), 10**12)
    assert [each.get_type() for each in late][-1:] == ["HEARTBEAT"]


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=80) | st.just(beat(m.MAVLink(None, 9, 9))), max_size=8))
def test_no_bytes_of_who_has_no_key_are_taken_or_change_the_clock(chunks):
    signing = Signing(KEY, wall_ns=Wall())
    assert set(taken(signing, *chunks)) <= {"RADIO_STATUS"}
    assert signing.stamp == 0
