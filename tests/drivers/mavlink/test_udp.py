"""UDP links, with plain sockets at the other end."""

import socket

from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink import udp as mavlink_link_udp
from robotctl.drivers.mavlink.admission import MAX_PEERS
from tests.drivers.mavlink.bench import HEARTBEAT, decode, frame, free_port, readable


def test_a_udp_client_sends_to_its_ground_station_and_hears_it(party, udp, eventually):
    station = udp()
    robot = party(f"udpout:127.0.0.1:{station.getsockname()[1]}")
    robot.step()
    robot.send()
    eventually(lambda: readable(station), robot.step)
    data, address = station.recvfrom(2048)
    assert [message.get_type() for message in decode(data)] == ["HEARTBEAT"]
    station.sendto(frame(), address)
    eventually(lambda: robot.received, robot.step)
    assert robot.received[0].peer.link == 0


def test_a_udp_client_does_not_listen_to_others(party, udp, eventually):
    station, stranger = udp(), udp()
    robot = party(f"udpout:127.0.0.1:{station.getsockname()[1]}")
    robot.step()
    robot.send()
    eventually(lambda: readable(station), robot.step)
    _, address = station.recvfrom(2048)
    stranger.sendto(frame(), address)
    station.sendto(frame(common.MAVLink_timesync_message(0, 1)), address)
    eventually(lambda: robot.received, robot.step)
    assert robot.names() == ["TIMESYNC"]


def test_a_ground_station_that_is_not_there_yet_is_no_error(party, udp, eventually):
    station = udp()
    port = station.getsockname()[1]
    station.close()
    robot = party(f"udpout:127.0.0.1:{port}")
    for _ in range(5):
        robot.step()
        robot.send()
    assert robot.status().open
    assert robot.status().errors == 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as late:
        late.bind(("127.0.0.1", port))
        eventually(lambda: readable(late), lambda: (robot.step(), robot.send()))


def test_a_udp_server_learns_several_peers_and_forgets_silent_ones(party, udp, eventually):
    robot = party("udpin:127.0.0.1:0")
    robot.step()
    stations = [udp(), udp(), udp()]
    stations[0].sendto(frame(), ("127.0.0.1", robot.status().port))
    stations[1].sendto(frame(), ("127.0.0.1", robot.status().port))
    stations[2].sendto(b"no frame", ("127.0.0.1", robot.status().port))
    eventually(lambda: len(robot.received) == 2 and robot.status().bad_bytes, robot.step)
    assert robot.status().peers == 2
    robot.send()
    for station in stations[:2]:
        eventually(lambda station=station: readable(station), robot.step)
    assert not readable(stations[2])
    robot.offset_ns += mavlink_link_udp.SILENT_NS // 2
    stations[1].sendto(frame(), ("127.0.0.1", robot.status().port))
    eventually(lambda: len(robot.received) == 3, robot.step)
    robot.offset_ns += mavlink_link_udp.SILENT_NS // 2 + 1_000_000_000
    robot.step()
    assert robot.status().peers == 1


def test_a_station_that_was_silent_and_comes_again_is_the_peer_of_before(party, udp, eventually):
    robot = party("udpin:127.0.0.1:0")
    robot.step()
    one, other = udp(), udp()
    for number, station in enumerate((one, other), 1):
        station.sendto(frame(), ("127.0.0.1", robot.status().port))
        eventually(lambda number=number: len(robot.received) == number, robot.step)
    robot.offset_ns += mavlink_link_udp.SILENT_NS + 1_000_000_000
    robot.step()
    assert robot.status().peers == 0
    for number, station in enumerate((other, one), 3):
        station.sendto(frame(), ("127.0.0.1", robot.status().port))
        eventually(lambda number=number: len(robot.received) == number, robot.step)
    first, second, second_again, first_again = [received.peer for received in robot.received]
    assert (first_again, second_again) == (first, second)
    assert first != second
    robot.links.reply(HEARTBEAT, first_again)
    eventually(lambda: readable(one), robot.step)
    assert not readable(other)


def test_strangers_that_come_and_go_do_not_fill_the_memory(party, udp, eventually):
    robot = party("udpin:127.0.0.1:0")
    robot.step()
    (link,) = robot.links._links
    for _ in range(mavlink_link_udp.MAX_FORMER // MAX_PEERS + 2):
        robot.received.clear()
        for _ in range(MAX_PEERS):
            udp().sendto(frame(), ("127.0.0.1", robot.status().port))
        eventually(lambda: len(robot.received) == MAX_PEERS, robot.step)
        robot.offset_ns += mavlink_link_udp.SILENT_NS + 1_000_000_000
        robot.step()
    assert len(link._former) == mavlink_link_udp.MAX_FORMER
    assert robot.status().peers == 0


def test_the_next_program_at_the_port_of_a_udp_client_is_another_peer(party, eventually):
    port = free_port()
    robot = party(f"udpout:127.0.0.1:{port}")
    peers = []
    for _ in range(2):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.bind(("127.0.0.1", port))
            eventually(
                lambda station=station: readable(station), lambda: robot.send() or robot.step()
            )
            _, address = station.recvfrom(2048)
            station.sendto(frame(), address)
            eventually(lambda: robot.received, robot.step)
        peers.append(robot.received.pop().peer)
        eventually(
            lambda: peers[-1] not in robot.links.peers(), lambda: robot.send() or robot.step()
        )
    assert peers[0] != peers[1]
