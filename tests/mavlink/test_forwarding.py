"""Between links: broadcasts to all others, the rest to where its target was heard, none twice."""

import dataclasses

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.errors import InvalidValue
from robotctl.mavlink.forwarding import MOST_IN_A_STEP, MOST_ROUTES
from robotctl.messages.mavlink_port import Peer, Received
from tests.mavlink.conftest import Bench

STATION, COMPANION, RADIO = Peer(0, 0), Peer(1, 0), Peer(2, 0)
BEAT = m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
seq = iter(range(10**9))


class Net(Bench):
    """A robot with three links."""

    def __init__(self, **config):
        super().__init__(links=3, **config)

    def arrive(self, peer, message, system=255, component=190, number=None):
        """Let a message come; return where it goes on."""
        codec = m.MAVLink(None, system, component)
        codec.seq = next(seq) % 256 if number is None else number
        self.links.forwarded.clear()
        frame = bytearray(message.pack(codec))
        received = m.MAVLink(None).decode(frame)
        self.links.incoming.append(Received(received, peer))
        self.step()
        return {peer for _, peers in self.links.forwarded for peer in peers}


@pytest.fixture
def net():
    found = Net()
    assert found.arrive(STATION, BEAT) == {COMPANION, RADIO}
    assert found.arrive(COMPANION, BEAT, 1, 191) == {STATION, RADIO}
    assert found.arrive(RADIO, BEAT, 7, 1) == {STATION, COMPANION}
    return found


def test_a_link_gets_nothing_that_its_filters_name(link_config):
    plain, filtered = link_config("udpin:127.0.0.1:0", "udpin:127.0.0.1:1")
    quiet = dataclasses.replace(
        filtered,
        blocked_messages=(m.MAVLINK_MSG_ID_PING,),
        blocked_systems=(8,),
        blocked_components=(158,),
    )
    net = Net(link=(plain, quiet))
    for peer, system in ((STATION, 255), (COMPANION, 1), (RADIO, 7)):
        net.arrive(peer, BEAT, system, 191)
    assert net.arrive(RADIO, BEAT, 9, 1) == {STATION, COMPANION}
    assert net.arrive(RADIO, ping(0, 0), 9, 1) == {STATION}
    assert net.arrive(RADIO, BEAT, 8, 1) == {STATION}
    assert net.arrive(RADIO, BEAT, 9, 158) == {STATION}
    assert net.arrive(STATION, ping(1, 191)) == set()
    with pytest.raises(InvalidValue, match="0 to 255, not 256"):
        dataclasses.replace(filtered, blocked_systems=(256,))


def ping(system, component):
    return m.MAVLink_ping_message(1, 2, system, component)


def test_targets_are_found_where_they_were_heard(net):
    assert net.arrive(STATION, ping(7, 1)) == {RADIO}
    assert net.arrive(STATION, ping(7, 0)) == {RADIO}
    assert net.arrive(STATION, ping(1, 191)) == {COMPANION}  # another component of our system
    assert net.arrive(COMPANION, ping(255, 190), 1, 191) == {STATION}
    assert net.arrive(STATION, ping(1, 1)) == set()
    assert net.arrive(STATION, ping(7, 99)) == set()
    assert net.arrive(STATION, ping(9, 1)) == set()
    assert net.arrive(RADIO, ping(7, 1), 7, 2) == set()  # not back to where it came from


def test_keys_radio_reports_and_our_own_messages_stay(net):
    setup = m.MAVLink_setup_signing_message(7, 1, [1] * 32, 0)
    assert net.arrive(STATION, setup) == set()
    radio = m.MAVLink_radio_status_message(1, 1, 99, 0, 0, 0, 0)
    assert net.arrive(RADIO, radio, 51, 68) == set()
    assert net.arrive(RADIO, BEAT, 1, 1) == set()


def test_what_goes_in_a_circle_is_passed_on_once_and_leads_nowhere(net):
    assert net.arrive(STATION, BEAT, 200, 1, number=5) == {COMPANION, RADIO}
    assert net.arrive(RADIO, BEAT, 200, 1, number=5) == set()
    assert net.arrive(COMPANION, ping(200, 1), 1, 191) == {STATION}
    net.run(1.0)
    assert net.arrive(STATION, BEAT, 200, 1, number=5) == {COMPANION, RADIO}


def test_a_frame_goes_on_as_it_came(net):
    codec = m.MAVLink(None, 7, 1)
    codec.seq = 77
    frame = bytes(ping(255, 190).pack(codec))
    net.links.forwarded.clear()
    net.links.incoming.append(Received(m.MAVLink(None).decode(bytearray(frame)), RADIO))
    net.step()
    ((message, _),) = net.links.forwarded
    assert bytes(message.get_msgbuf()) == frame


def test_a_flood_of_invented_systems_is_bounded(net):
    for k in range(4 * MOST_IN_A_STEP):
        codec = m.MAVLink(None, k % 250 + 1, 2 + k // 250)
        message = m.MAVLink(None).decode(bytearray(BEAT.pack(codec)))
        net.links.incoming.append(Received(message, RADIO))
    net.links.forwarded.clear()
    net.step()
    assert len(net.links.forwarded) == MOST_IN_A_STEP
    assert len(net.telemetry._forwarder._routes) == MOST_ROUTES
