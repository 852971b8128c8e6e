"""What `tools/fuzz.py` tries inputs on, and the inputs that it has found.

A corpus is a text file, an input in hexadecimal on each line: each reaches code that no other one
does.
"""

from __future__ import annotations

from pathlib import Path

from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.frames import STALE_NS, FrameReader
from robotctl.mavlink.services.registry import SERVICES
from robotctl.messages.mavlink_port import Peer, Received
from tests.mavlink.conftest import Bench

CORPUS = Path(__file__).parent / "corpus"
LONGEST = 1024
"""Bytes of an input."""
PEER = Peer(0, 0)
REQUEST = common.MAV_CMD_REQUEST_MESSAGE
HANDLED = sorted(frozenset().union(*(service.handles for service in SERVICES)))


def parser(data: bytes) -> None:
    """Cut a stream at places that its first byte names: the same messages must come out."""
    if not data:
        return
    size, stream = data[0] + 1, data[1:]
    whole, cut = FrameReader(common.MAVLink(None, 1, 1)), FrameReader(common.MAVLink(None, 1, 1))
    expected = whole.feed(stream, 0) + whole.expire(STALE_NS + 1)
    found = []
    for begin in range(0, len(stream), size):
        found += cut.feed(stream[begin : begin + size], 0)
    found += cut.expire(STALE_NS + 1)
    if cut.unknown or whole.unknown:
        return  # whether a message of no dialect is one is judged by the byte behind it
    assert [each.get_msgbuf() for each in found] == [each.get_msgbuf() for each in expected]
    assert cut.bad_bytes == whole.bad_bytes


def services(data: bytes) -> None:
    """Send a conversation; the robot must still answer who comes afterwards.

    A message is its place among those that services take, the time before it in steps, the length
    of its payload, and the payload.
    """
    bench = Bench()
    bench.step(bench.control(), bench.navigation())
    while len(data) >= 3:
        number, wait, length = HANDLED[data[0] % len(HANDLED)], data[1] % 64, data[2]
        payload, data = data[3 : 3 + length], data[3 + length :]
        bench.links.incoming.append(Received(_message(number, payload), PEER))
        bench.step(bench.control(), bench.navigation(), advance_s=0.02 * (wait + 1))
    bench.run(2.0, rate_hz=10)
    bench.take()
    bench.command(REQUEST, common.MAVLINK_MSG_ID_AUTOPILOT_VERSION, system=254)
    bench.run(0.1)
    answers = [each.result for each in bench.messages("COMMAND_ACK") if each.command == REQUEST]
    assert answers == [common.MAV_RESULT_ACCEPTED]


TARGETS = {"parser": parser, "services": services}


def corpus(target: str) -> list[bytes]:
    """Return the inputs kept for a target."""
    lines = (CORPUS / f"{target}.txt").read_text(encoding="ascii").splitlines()
    return [bytes.fromhex(line) for line in lines]


def _message(number: int, payload: bytes) -> common.MAVLink_message:
    """Return a whole frame's message, whatever it says."""
    header = bytes([0xFD, len(payload), 0, 0, 0, 255, 190, *number.to_bytes(3, "little")])
    extra = common.mavlink_map[number].crc_extra
    crc = common.x25crc(header[1:] + payload + bytes([extra])).crc
    reader = FrameReader(common.MAVLink(None, 1, 1))
    (message,) = reader.feed(header + payload + crc.to_bytes(2, "little"), 0)
    return message
