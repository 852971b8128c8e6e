"""A radio without room gets the streams more slowly, the other links as before."""

from pymavlink.dialects.v20 import common as m

from robotctl.messages.mavlink_port import Peer
from tests.mavlink.conftest import Bench


def rates(bench, seconds, txbuf=None):
    """Return how many ATTITUDE, and HEARTBEAT, a second each link gets."""
    for _ in range(seconds):
        if txbuf is not None:
            radio = m.MAVLink_radio_status_message(1, 1, txbuf, 0, 0, 0, 0)
            bench.receive(radio, system=51, component=68, peer=Peer(0, 0))
        bench.run(1.0)
    sent = bench.take()
    return [
        tuple(
            sum(x.get_type() == name and peer.link == link for x, peer in sent) / seconds
            for name in ("ATTITUDE", "HEARTBEAT")
        )
        for link in (0, 1)
    ]


def test_streams_of_a_radio_follow_its_free_room():
    bench = Bench(links=2)
    bench.run(1.0)
    bench.take()
    (before, _), other = rates(bench, 4)
    assert 9.0 <= before <= 11.0
    rates(bench, 8, txbuf=5)
    slow = rates(bench, 8, txbuf=5)
    assert slow[0][0] < 0.2 * before
    assert slow[1][0] >= 0.9 * other[0]
    assert slow[0][1] == slow[1][1]  # heartbeats
    rates(bench, 16, txbuf=100)
    assert rates(bench, 4, txbuf=100)[0][0] >= 0.9 * before
    rates(bench, 8, txbuf=5)
    rates(bench, 14)  # the radio is gone
    assert rates(bench, 4)[0][0] >= 0.9 * before
