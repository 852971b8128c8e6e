"""Bytes of all kinds through the parser and all services: nothing raises, nothing invalid acts."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.frames import STALE_NS, FrameReader
from robotctl.messages.control import EmergencyStop
from robotctl.messages.mavlink_port import Peer, Received
from tests.mavlink.fuzzing import TARGETS, corpus

HANDLED = [
    0, 11, 20, 21, 23, 38, 39, 41, 44, 45, 48, 66, 69, 73, 75, 76, 80, 84, 102, 110, 111, 117, 119,
    121, 122, 331, 386, 388, 412,
]  # fmt: skip

ACTING = [
    common.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
    common.MAVLink_command_long_message(1, 1, 185, 0, 1, 0, 0, 0, 0, 0, 0),
    common.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, 15, 0, 0, 0, 0, 0),
    common.MAVLink_set_mode_message(1, 1, 10),
    common.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0),
    common.MAVLink_vision_position_estimate_message(1, 2.0, 3.0, 0, 0, 0, 0.5),
    common.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x5C7, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0.1
    ),
]


def pack(message, seq=0, v1=False):
    codec = common.MAVLink(None, 255, 190)
    codec.seq = seq
    return bytearray(message.pack(codec, force_mavlink1=v1))


def requests_of(bench, data):
    """Pass bytes through a parser into telemetry; return requests and messages that got through."""
    reader = FrameReader(common.MAVLink(None, 1, 1))
    messages = reader.feed(bytes(data), 0) + reader.expire(STALE_NS + 1)
    bench.links.incoming += [Received(message, Peer(0, 0)) for message in messages]
    requests = bench.step(bench.control())
    bench.step(bench.control())
    return requests, messages


def test_each_acting_frame_acts_when_it_is_whole(make_bench):
    for message in ACTING:
        for v1 in (False, True):
            requests, _ = requests_of(make_bench(), pack(message, v1=v1))
            assert len(requests) == 1


@settings(max_examples=300, deadline=None)
@given(st.lists(st.binary(max_size=300) | st.sampled_from([bytes(pack(m)) for m in ACTING])))
def test_random_bytes_never_raise_and_only_whole_frames_act(make_bench, chunks):
    requests, messages = requests_of(make_bench(), b"".join(chunks))
    assert len(requests) <= len(messages)


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(ACTING), st.booleans(), st.data())
def test_a_frame_with_a_changed_byte_never_acts(make_bench, message, v1, data):
    """A CRC-16 finds every burst of up to 16 bits, so two neighbouring changed bytes always."""
    frame = pack(message, v1=v1)
    position = data.draw(st.integers(0, len(frame) - 2))
    frame[position] ^= data.draw(st.integers(1, 255))
    frame[position + 1] ^= data.draw(st.integers(0, 255))
    requests, _ = requests_of(make_bench(), frame)
    assert requests == []


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(ACTING), st.booleans(), st.data())
def test_a_frame_with_missing_bytes_never_acts(make_bench, message, v1, data):
    frame = pack(message, v1=v1)
    first = data.draw(st.integers(0, len(frame) - 1))
    last = data.draw(st.integers(first + 1, len(frame)))
    requests, _ = requests_of(make_bench(), frame[:first] + frame[last:])
    assert requests == []


@settings(max_examples=400, deadline=None)
@given(
    number=st.sampled_from(HANDLED) | st.sampled_from(sorted(common.mavlink_map)),
    payload=st.binary(max_size=255),
    system=st.integers(0, 255),
)
def test_any_payload_with_a_right_checksum_is_survived(make_bench, number, payload, system):
    """Valid frames with nonsense inside, of every message there is."""
    header = bytes([0xFD, len(payload), 0, 0, 0, system, 190, *number.to_bytes(3, "little")])
    extra = common.mavlink_map[number].crc_extra if number >= 0 else 0
    crc = common.x25crc(header[1:] + payload + bytes([extra])).crc
    requests, _ = requests_of(make_bench(), header + payload + crc.to_bytes(2, "little"))
    assert len(requests) <= 1
    assert number in HANDLED or requests == []


def test_a_signed_frame_is_read_without_its_signature(make_bench):
    """A robot without keys does not look at signatures."""
    codec = common.MAVLink(None, 255, 190)
    codec.signing.secret_key = b"k" * 32
    codec.signing.sign_outgoing = True
    codec.signing.timestamp = 1
    requests, _ = requests_of(make_bench(), ACTING[1].pack(codec))
    assert isinstance(requests[0], EmergencyStop)


@pytest.mark.parametrize("target", TARGETS)
def test_what_fuzzing_has_found_upsets_nothing(target):
    """Inputs that `tools/fuzz.py` has kept: between them they reach what it has reached."""
    inputs = corpus(target)
    assert len(inputs) > 100
    for data in inputs:
        TARGETS[target](data)
