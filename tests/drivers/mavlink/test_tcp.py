"""TCP links, with plain sockets at the other end."""

import contextlib
import socket

from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.admission import MAX_PEERS
from tests.drivers.mavlink.bench import (
    HEARTBEAT,
    answered,
    beat,
    decode,
    frame,
    free_port,
    readable,
)


def test_silent_clients_of_a_tcp_server_do_not_lock_out_a_ground_station(party, tcp, eventually):
    robot = party("tcpin:127.0.0.1:0")
    robot.step()
    silent = [tcp(robot.status().port) for _ in range(MAX_PEERS)]
    eventually(lambda: robot.status().peers == MAX_PEERS, robot.step)
    station = tcp(robot.status().port)
    beat(robot, eventually, station)
    assert answered(robot, eventually, station)
    assert sum(readable(each) and each.recv(99) == b"" for each in silent) == 1


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
