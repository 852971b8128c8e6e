"""Links on real sockets and a pseudo-terminal, with plain sockets at the other end."""

import contextlib
import itertools
import os
import re
import select
import socket
import time
import tty
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink import udp as mavlink_link_udp
from robotctl.drivers.mavlink.admission import MAX_PEERS
from robotctl.drivers.mavlink.base import READ_SIZE
from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.drivers.mavlink.lookup import HostLookup
from robotctl.drivers.mavlink.signing import MINUTE, Memory, Signing

HEARTBEAT = common.MAVLink_heartbeat_message(10, 3, 1, 4, 3, 3)


def frame(message=None, seq=0):
    codec = common.MAVLink(None, 255, 190)
    codec.seq = seq
    message = message or common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    return message.pack(codec)


def decode(data):
    """Return the messages in `data` as pymavlink reads them, and nothing but messages."""
    codec = common.MAVLink(None)
    return codec.parse_buffer(bytearray(data)) or []


class Party:
    """Links and a record of what they received; `step` polls them."""

    def __init__(self, *configs, signing=None):
        self.links = MavlinkLinks(configs, signing=signing)
        self.received = []
        self.offset_ns = 0

    def step(self):
        self.received += self.links.poll(time.monotonic_ns() + self.offset_ns, 0.0)

    def status(self, link=0):
        return self.links.status()[link]

    def names(self):
        return [received.message.get_type() for received in self.received]

    def send(self):
        self.links.broadcast(HEARTBEAT)
        self.links.flush()


@pytest.fixture
def party(link_config):
    """Return a function that opens links, closed after the test."""
    with contextlib.ExitStack() as stack:

        def start(*urls, signing=None):
            started = Party(*link_config(*urls), signing=signing)
            stack.enter_context(started.links)
            return started

        yield start


@pytest.fixture
def udp():
    """Return a function that makes UDP sockets, closed after the test."""
    with contextlib.ExitStack() as stack:

        def make():
            made = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            made.bind(("127.0.0.1", 0))
            made.setblocking(False)
            return made

        yield make


@pytest.fixture
def tcp():
    """Return a function that connects to a port, closed after the test."""
    with contextlib.ExitStack() as stack:

        def connect(port):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), 5.0))
            connection.setblocking(False)
            return connection

        yield connect


def readable(source):
    return bool(select.select([source], [], [], 0)[0])


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


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


def beat(robot, eventually, client):
    """Let the heartbeat of a ground station arrive."""
    before = len(robot.received)
    client.send(frame())
    eventually(lambda: len(robot.received) > before, robot.step)


def answered(robot, eventually, client):
    """Say whether a client gets what is sent to everybody, after all that it got before."""
    eventually(lambda: not readable(client) or not client.recv(4096), robot.step)
    robot.send()
    robot.step()
    time.sleep(0.02)
    return readable(client)


def test_clients_that_come_and_go_do_not_lock_out_the_next_ground_station(server, eventually):
    robot, call = server
    passing = [call() for _ in range(MAX_PEERS)]
    for client in passing:
        beat(robot, eventually, client)
    last = call()
    beat(robot, eventually, last)
    assert answered(robot, eventually, last)
    assert robot.status().peers == MAX_PEERS


def test_silent_clients_of_a_tcp_server_do_not_lock_out_a_ground_station(party, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0")
    robot.step()
    silent = [tcp(robot.status().port) for _ in range(MAX_PEERS)]
    eventually(lambda: robot.status().peers == MAX_PEERS, robot.step)
    station = tcp(robot.status().port)
    beat(robot, eventually, station)
    assert answered(robot, eventually, station)
    assert sum(readable(each) and each.recv(99) == b"" for each in silent) == 1


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


def test_a_tcp_client_that_sends_nothing_for_ten_seconds_is_dropped(party, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0")
    robot.step()
    silent, alive = tcp(robot.status().port), tcp(robot.status().port)
    eventually(lambda: robot.status().peers == 2, robot.step)
    robot.offset_ns += 9_000_000_000
    robot.step()
    assert robot.status().peers == 2
    beat(robot, eventually, alive)
    robot.offset_ns += 2_000_000_000
    robot.step()
    assert robot.status().peers == 1
    eventually(lambda: readable(silent), robot.step)
    assert silent.recv(99) == b""


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


def test_a_tcp_server_serves_several_clients_and_survives_their_going(party, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0")
    robot.step()
    clients = [tcp(robot.status().port) for _ in range(3)]
    eventually(lambda: robot.status().peers == 3, robot.step)
    clients[0].sendall(frame()[:10])
    clients[1].sendall(frame())
    eventually(lambda: robot.received, robot.step)
    clients[0].sendall(frame()[10:])
    eventually(lambda: len(robot.received) == 2, robot.step)
    assert robot.received[0].peer != robot.received[1].peer
    clients[0].close()
    eventually(lambda: robot.status().peers == 2, lambda: (robot.step(), robot.send()))
    robot.send()
    eventually(lambda: readable(clients[1]) and readable(clients[2]), robot.step)
    assert robot.status().open


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


def test_a_tcp_server_serves_eight_clients_and_lets_as_many_wait(party, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0")
    robot.step()
    for _ in range(17):
        tcp(robot.status().port)
    eventually(lambda: robot.status().errors == 1, robot.step)
    assert robot.status().peers == 8


def test_a_client_that_reads_nothing_loses_old_telemetry_and_blocks_nobody(party, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0")
    robot.step()
    slow, fast = tcp(robot.status().port), tcp(robot.status().port)
    eventually(lambda: robot.status().peers == 2, robot.step)
    message = common.MAVLink_statustext_message(6, b"x" * 50)
    taken = bytearray()

    def flood():
        for _ in range(600):
            robot.links.broadcast(message)
        robot.links.flush()
        robot.step()
        with contextlib.suppress(BlockingIOError):
            taken.extend(fast.recv(1 << 20))

    eventually(lambda: robot.status().dropped > 10_000, flood)
    assert robot.status().peers == 2
    drained = bytearray()

    def drain():
        robot.step()
        robot.links.flush()
        with contextlib.suppress(BlockingIOError):
            drained.extend(slow.recv(1 << 20))

    eventually(lambda: not readable(slow) and len(drained) > 30_000, drain)
    messages = decode(drained)
    assert {message.get_type() for message in messages} == {"STATUSTEXT"}
    assert len(taken) > len(drained)


def test_a_tcp_server_whose_port_is_taken_opens_when_it_is_free(party, eventually):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        robot = party(f"tcpin:127.0.0.1:{other.getsockname()[1]}")
        robot.step()
        assert not robot.status().open
        assert "in use" in robot.status().last_error
    robot.offset_ns += 1_000_000_000
    eventually(lambda: robot.status().open, robot.step)


def test_a_tcp_client_connects_when_the_server_comes_and_again_when_it_returns(party, eventually):
    port = free_port()
    robot = party(f"tcpout:127.0.0.1:{port}")
    eventually(lambda: robot.status().errors, robot.step)
    for life in range(2):
        with socket.create_server(("127.0.0.1", port)) as server:
            robot.offset_ns += 10_000_000_000
            eventually(lambda: robot.status().peers, robot.step)
            connection, _ = server.accept()
            with connection:
                connection.sendall(frame())
                eventually(lambda life=life: len(robot.received) == life + 1, robot.step)
                robot.send()
                assert [m.get_type() for m in decode(connection.recv(4096))] == ["HEARTBEAT"]
        eventually(lambda: not robot.status().peers, robot.step)
    assert robot.status().opened == 2


def test_a_client_waits_longer_after_each_failure(party, eventually):
    robot = party(f"tcpout:127.0.0.1:{free_port()}")
    attempts = 0
    for _ in range(600):  # 60 s, in steps of 0.1 s
        robot.step()
        robot.offset_ns += 100_000_000
    attempts = robot.status().errors
    assert 10 <= attempts <= 20  # 0.25 + 0.5 + 1 + 2 + 4 + 5 + 5 ...


def test_an_answer_to_a_lost_connection_does_not_go_to_the_next_one(party, eventually):
    port = free_port()
    robot = party(f"tcpout:127.0.0.1:{port}")
    with socket.create_server(("127.0.0.1", port)) as server:
        robot.offset_ns += 10_000_000_000
        eventually(lambda: robot.status().peers, robot.step)
        first, _ = server.accept()
        first.sendall(frame())
        eventually(lambda: robot.received, robot.step)
        first.close()
        eventually(lambda: not robot.status().peers, robot.step)
        robot.offset_ns += 10_000_000_000
        eventually(lambda: robot.status().peers, robot.step)
        second, _ = server.accept()
        with second:
            robot.links.reply(HEARTBEAT, robot.received[0].peer)
            robot.links.flush()
            robot.send()
            assert [m.get_seq() for m in decode(second.recv(4096))] == [0]


@pytest.fixture
def pseudo_terminal(tmp_path):
    """Return a function that makes a serial line at a fixed path: (our end, path)."""
    path = tmp_path / "tty"
    descriptors = []

    def make():
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        os.set_blocking(ours, False)
        descriptors.append(ours)
        return ours

    def unplug():
        os.close(descriptors.pop())

    yield make, unplug, path
    for descriptor in descriptors:
        os.close(descriptor)


def test_a_serial_line_carries_frames_and_is_reopened_after_unplugging(
    party, pseudo_terminal, eventually
):
    make, unplug, path = pseudo_terminal
    robot = party(f"serial:{path}:57600")
    robot.step()
    assert not robot.status().open
    assert robot.status().errors == 1
    for life in range(2):
        line = make()
        robot.offset_ns += 10_000_000_000
        eventually(lambda: robot.status().open, robot.step)
        os.write(line, b"boot noise" + frame())
        eventually(lambda life=life: len(robot.received) == life + 1, robot.step)
        robot.send()
        eventually(lambda line=line: readable(line), robot.step)
        assert [m.get_type() for m in decode(os.read(line, 4096))] == ["HEARTBEAT"]
        unplug()
        eventually(lambda: not robot.status().open, robot.step)
    assert robot.status().opened == 2
    assert robot.status().bad_bytes == 2 * len(b"boot noise")


def test_a_serial_line_that_takes_nothing_drops_telemetry(party, pseudo_terminal, eventually):
    make, _, path = pseudo_terminal
    make()
    robot = party(f"serial:{path}:57600")
    eventually(lambda: robot.status().open, robot.step)
    for _ in range(2000):
        robot.send()
    assert robot.status().dropped > 0
    assert robot.status().open


def test_a_device_that_is_no_serial_line_is_an_error_of_the_link(party):
    robot = party("serial:/dev/null:57600", "serial:/nowhere/tty:57600")
    robot.step()
    assert [status.open for status in robot.links.status()] == [False, False]
    assert all(status.last_error for status in robot.links.status())


def test_a_host_that_is_unknown_does_not_hold_up_the_other_links(party, udp, eventually):
    station = udp()
    robot = party(
        "tcpout:no-such-host.invalid:5760", f"udpout:localhost:{station.getsockname()[1]}"
    )
    eventually(lambda: robot.status(1).open and robot.status(0).errors, robot.step)
    robot.send()
    eventually(lambda: readable(station), robot.step)
    assert not robot.status(0).open


@pytest.mark.parametrize("host", ["192.168.1..20", ".local", "a" * 64])
@pytest.mark.parametrize("kind", ["udpout", "tcpout", "udpin", "tcpin"])
def test_a_host_that_is_no_name_is_refused_before_there_are_links(party, kind, host):
    with pytest.raises(ValueError, match="is no host; allowed: ") as refused:
        party(f"{kind}:{host}:14550")
    assert f'"{host}"' in str(refused.value)


@pytest.mark.parametrize("host", ["192.168.1..20", ".local", "a" * 64])
@pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_STREAM])
def test_looking_up_a_host_that_is_no_name_is_an_error_of_the_network(kind, host):
    with pytest.raises(OSError, match=re.escape(host)):
        HostLookup(host, 14550, kind).result()


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
