"""Links on real sockets, and what is needed at their other end."""

import select
import socket
import time

from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.link import MavlinkLinks

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


def readable(source):
    return bool(select.select([source], [], [], 0)[0])


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


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
