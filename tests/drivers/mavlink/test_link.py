"""All links together: peers, replies, floods and newcomers, on real sockets."""

import contextlib
import itertools
import os
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.admission import MAX_PEERS
from robotctl.drivers.mavlink.base import READ_SIZE
from robotctl.drivers.mavlink.signing import MINUTE, Memory, Signing
from tests.drivers.mavlink.bench import HEARTBEAT, Party, answered, beat, decode, frame, readable


@pytest.fixture(params=["udpin", "tcpin"])
def server(request, party, udp, tcp):
    """Return a server, and a function that makes a client whose `send` reaches it."""
    robot = party(f"{request.param}:127.0.0.1:0")
    robot.step()

    def call():
        if request.param == "tcpin":
            return tcp(robot.status().port)
        made = udp()
        made.connect(("127.0.0.1", robot.status().port))
        return made

    return robot, call


def test_clients_that_come_and_go_do_not_lock_out_the_next_ground_station(server, eventually):
    robot, call = server
    passing = [call() for _ in range(MAX_PEERS)]
    for client in passing:
        beat(robot, eventually, client)
    last = call()
    beat(robot, eventually, last)
    assert answered(robot, eventually, last)
    assert robot.status().peers == MAX_PEERS


def test_a_ground_station_that_stays_in_touch_keeps_its_place(server, eventually):
    robot, call = server
    stations = [call() for _ in range(MAX_PEERS)]
    for _ in range(3):
        for station in stations:
            beat(robot, eventually, station)
        robot.offset_ns += 1_000_000_000
    known = set(robot.links.peers())
    ninth = call()
    for _ in range(2):
        ninth.send(frame())
        robot.step()
        time.sleep(0.01)
    robot.step()
    assert set(robot.links.peers()) == known
    for station in stations[1:]:
        beat(robot, eventually, station)
    robot.offset_ns += 2_500_000_000
    for station in stations[1:]:
        beat(robot, eventually, station)
    beat(robot, eventually, ninth)
    assert len(set(robot.links.peers()) & known) == MAX_PEERS - 1


def test_a_reply_goes_to_the_peer_that_asked_alone(party, udp, eventually):
    robot = party("udpin:127.0.0.1:0")
    robot.step()
    first, second = udp(), udp()
    first.sendto(frame(), ("127.0.0.1", robot.status().port))
    eventually(lambda: len(robot.received) == 1, robot.step)
    second.sendto(frame(), ("127.0.0.1", robot.status().port))
    eventually(lambda: len(robot.received) == 2, robot.step)
    robot.links.reply(HEARTBEAT, robot.received[1].peer)
    eventually(lambda: readable(second), robot.step)
    assert not readable(first)


def test_each_peer_sees_its_own_unbroken_sequence_numbers(party, udp, tcp, eventually):
    robot = party("udpin:127.0.0.1:0", "tcpin:127.0.0.1:0")
    robot.step()
    station = udp()
    station.sendto(frame(), ("127.0.0.1", robot.status().port))
    eventually(lambda: robot.received, robot.step)
    robot.send()
    client = tcp(robot.status(1).port)
    eventually(lambda: robot.status(1).peers, robot.step)
    for _ in range(3):
        robot.send()
    numbers = []
    while readable(station):
        numbers += [message.get_seq() for message in decode(station.recv(2048))]
    assert numbers == [0, 1, 2, 3]
    eventually(lambda: readable(client), robot.step)
    assert [message.get_seq() for message in decode(client.recv(4096))] == [0, 1, 2]


@pytest.mark.parametrize("kind", ["tcpin", "udpin"])
def test_a_command_behind_half_a_frame_gets_through_without_more_bytes(
    party, udp, tcp, eventually, kind
):
    robot = party(f"{kind}:127.0.0.1:0")
    robot.step()
    port = robot.status().port
    if kind == "tcpin":
        tcp(port).sendall(b"\xfd\xff\x00" + frame())
        eventually(lambda: robot.status().peers, robot.step)
        robot.step()
    else:
        station = udp()
        for data in (frame(), b"\xfd\xff\x00" + frame()):
            station.sendto(data, ("127.0.0.1", port))
        eventually(lambda: len(robot.received) == 1, robot.step)
    before = len(robot.received)
    robot.step()
    robot.offset_ns += 500_000_000
    eventually(lambda: len(robot.received) == before + 1, robot.step)
    assert bytes(robot.received[-1].message.get_msgbuf()) == frame()


def test_the_descriptor_of_all_links_becomes_readable_when_something_comes(party, udp, eventually):
    robot = party("udpin:127.0.0.1:0", "tcpin:127.0.0.1:0")
    robot.step()
    assert not readable(robot.links.fileno())
    udp().sendto(frame(), ("127.0.0.1", robot.status().port))
    eventually(lambda: readable(robot.links.fileno()), lambda: None)
    robot.step()
    assert not readable(robot.links.fileno())


def test_polling_with_a_time_out_waits_for_what_comes(party):
    robot = party("udpin:127.0.0.1:0")
    robot.step()
    begin = time.monotonic()
    assert robot.links.poll(time.monotonic_ns(), 0.05) == []
    assert time.monotonic() - begin >= 0.045


def test_a_flood_of_garbage_on_one_link_leaves_the_other_working(party, udp, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0", "udpin:127.0.0.1:0")
    robot.step()
    vandal, station = tcp(robot.status(0).port), udp()
    garbage = os.urandom(4000) + b"\xfd" * 4000 + b"\xfe\x09" * 4000

    def flood():
        with contextlib.suppress(BlockingIOError):
            while True:
                vandal.send(garbage)

    read = [0]
    for _ in range(50):
        flood()
        robot.step()
        read.append(robot.status(0).bad_bytes)
    assert read[-1] > 100_000
    # What waits for its end from one step to the next is shorter than the longest message.
    assert max(b - a for a, b in itertools.pairwise(read)) <= READ_SIZE + 280
    station.sendto(frame(), ("127.0.0.1", robot.status(1).port))
    eventually(lambda: "HEARTBEAT" in robot.names(), lambda: (flood(), robot.step()))


def test_closed_links_leave_nothing_open(link_config, tcp):
    before = set(Path("/proc/self/fd").iterdir())
    robot = Party(*link_config("udpin:127.0.0.1:0", "tcpin:127.0.0.1:0", "udpout:127.0.0.1:9"))
    robot.step()
    tcp(robot.status(1).port)
    robot.step()
    robot.links.close()
    assert len(set(Path("/proc/self/fd").iterdir()) - before) == 1  # the client of this test


def signing_station(stamp, key):
    """Return pymavlink as a ground station that signs."""
    codec = common.MAVLink(None, 255, 190)
    codec.robust_parsing = True
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp = stamp
    return codec


@pytest.mark.parametrize("key", [bytes(range(32)), bytes(32)], ids=["right", "wrong"])
def test_a_newcomer_who_has_the_key_but_is_late_learns_the_time_and_is_served(
    party, udp, eventually, key
):
    """Its number is that of a station whose clock is ten years ahead."""
    now = (time.time_ns() - 1_420_070_400 * 10**9) // 10_000
    ahead = now + 10 * 365 * 1440 * MINUTE
    signing = Signing(bytes(range(32)), memory=Memory(0, (((255, 190, 0), ahead),)))
    robot = party("udpin:127.0.0.1:0", signing=signing)
    robot.step()
    codec, station = signing_station(now, key), udp()
    address = "127.0.0.1", robot.status().port
    heartbeat = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    station.sendto(heartbeat.pack(codec), address)
    eventually(lambda: robot.status().bad_bytes, robot.step)
    if key != signing.key:
        assert not readable(station)
        return
    eventually(lambda: readable(station), robot.step)
    (told,) = codec.parse_buffer(bytearray(station.recv(2048)))
    assert told.get_type() == "SYSTEM_TIME"
    assert codec.signing.timestamp > ahead
    station.sendto(heartbeat.pack(codec), address)
    eventually(lambda: robot.received, robot.step)
    robot.send()
    eventually(lambda: readable(station), robot.step)
    answers = codec.parse_buffer(bytearray(station.recv(2048)))
    assert [each.get_type() for each in answers] == ["HEARTBEAT"]


def test_a_flood_of_one_sender_costs_no_other_a_message(party, udp, eventually):
    robot = party("udpin:127.0.0.1:0")
    robot.step()
    flooder, station = udp(), udp()
    address = "127.0.0.1", robot.status().port
    for each in (flooder, station):
        each.sendto(frame(), address)
    eventually(lambda: robot.status().peers == 2, robot.step)
    robot.received.clear()
    sent = 40
    for number in range(sent):
        for _ in range(600):
            flooder.sendto(frame(common.MAVLink_param_set_message(1, 1, b"NO", 1.0, 9)), address)
        station.sendto(frame(seq=number), address)
        begin_s = time.perf_counter()
        robot.step()
        assert time.perf_counter() - begin_s < 1.0
    eventually(lambda: robot.names().count("HEARTBEAT") == sent, robot.step)
    assert robot.names().count("PARAM_SET") < 600 * sent
