"""Who speaks MAVLink 1 only is answered in MAVLink 1, as pymavlink's dialect of it reads it."""

import socket

import pytest
from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink import frames as mavlink_link_frames
from robotctl.drivers.mavlink.base import Channel, LinkContext
from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.drivers.mavlink.signing import Signing
from robotctl.messages.mavlink_port import LinkConfig, Peer

SECOND_NS = 1_000_000_000
PARAM_EXT_VALUE = 322
OLD, NEW = v1.MAVLink(None, 255, 190), common.MAVLink(None, 255, 190)


def old_beat():
    return v1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(OLD)


def new_beat():
    return common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(NEW)


@pytest.fixture
def channel():
    return Channel(Peer(0, 0), LinkContext(None, [], 1, 1, Signing()))


def example(kind):
    """Return a message with every field filled, the fields of MAVLink 2 too."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))

    def value(name):
        if types[name] == "char":
            return b"abc"[: lengths[name] or 1]
        one = 1.5 if types[name] in {"float", "double"} else 7
        return [one] * lengths[name] if lengths[name] else one

    return kind(*(value(name) for name in kind.fieldnames))


@pytest.mark.parametrize("number", sorted(v1.mavlink_map))
def test_every_message_of_mavlink_1_reads_the_same_there(channel, number):
    channel.reader.feed(old_beat(), SECOND_NS)
    message = example(common.mavlink_map[number])
    frame = channel.encode(message)
    assert frame[0] == 0xFE
    (read,) = v1.MAVLink(None).parse_buffer(bytearray(frame))
    assert (read.get_srcSystem(), read.get_srcComponent()) == (1, 1)
    for name in read.fieldnames:
        assert getattr(read, name) == getattr(message, name), name


def test_a_message_of_mavlink_2_alone_is_not_sent_to_it(channel):
    message = example(common.mavlink_map[PARAM_EXT_VALUE])
    assert channel.encode(message)[0] == 0xFD
    channel.reader.feed(old_beat(), SECOND_NS)
    assert channel.encode(message) is None


def test_who_sends_mavlink_2_as_well_is_answered_in_it_and_again_in_1_when_it_never_does(channel):
    message = example(common.mavlink_map[0])
    channel.reader.feed(old_beat(), SECOND_NS)
    assert channel.encode(message)[0] == 0xFE
    channel.reader.feed(new_beat(), 2 * SECOND_NS)
    channel.reader.feed(old_beat(), 3 * SECOND_NS)
    assert channel.encode(message)[0] == 0xFD
    late_ns = 2 * SECOND_NS + mavlink_link_frames.FORGET_NS + 1
    channel.reader.feed(old_beat(), late_ns)
    assert channel.encode(message)[0] == 0xFE


def test_sequence_numbers_go_on_over_a_change_of_the_version(channel):
    message = example(common.mavlink_map[0])
    sequence = [channel.encode(message)[4]]
    channel.reader.feed(old_beat(), SECOND_NS)
    sequence += [channel.encode(message)[2] for _ in range(2)]
    channel.reader.feed(new_beat(), SECOND_NS)
    sequence.append(channel.encode(message)[4])
    assert sequence == [0, 1, 2, 3]


def test_two_ground_stations_on_one_link_are_each_answered_in_their_own_version():
    with (
        MavlinkLinks([LinkConfig("udpin:127.0.0.1:0")]) as links,
        socket.socket(type=socket.SOCK_DGRAM) as old,
        socket.socket(type=socket.SOCK_DGRAM) as new,
    ):
        links.poll(0)
        for number, (station, beat) in enumerate(((old, old_beat()), (new, new_beat())), 1):
            station.settimeout(5.0)
            station.connect(("127.0.0.1", links.status()[0].port))
            station.send(beat)
            while links.status()[0].peers < number:
                links.poll(SECOND_NS, 0.1)
        links.broadcast(common.MAVLink_heartbeat_message(10, 3, 1, 4, 3, 3))
        links.broadcast(example(common.mavlink_map[PARAM_EXT_VALUE]))
        links.broadcast(common.MAVLink_statustext_message(4, b"stopped", 0, 0))
        assert [old.recv(300)[0] for _ in range(2)] == [0xFE] * 2
        assert [new.recv(300)[0] for _ in range(3)] == [0xFD] * 3
