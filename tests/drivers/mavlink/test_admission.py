"""Who yields a place to whom, as its rules say."""

import itertools

import pytest
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.admission import ESTABLISHED_NS, QUIET_NS, Standing, displaced

GCS, COMPUTER = common.MAV_TYPE_GCS, common.MAV_TYPE_ONBOARD_CONTROLLER
NOW_NS = 100_000_000_000


def heartbeat(kind):
    return common.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)


def peer(kind=GCS, since_ns=ESTABLISHED_NS, silent_ns=0):
    """Return the standing of a peer with two heartbeats."""
    standing = Standing()
    for stamp_ns in (NOW_NS - silent_ns - since_ns, NOW_NS - silent_ns):
        standing.hear([heartbeat(kind)], stamp_ns)
    return standing


def newcomer(kind=GCS):
    standing = Standing()
    standing.hear([heartbeat(kind)], NOW_NS)
    return standing


BRIEF = ESTABLISHED_NS - 1
QUIET = QUIET_NS + 1


@pytest.mark.parametrize(
    ("served", "kind", "yields"),
    [
        (peer(), GCS, False),
        (peer(silent_ns=QUIET_NS), GCS, False),
        (peer(silent_ns=QUIET), GCS, True),
        (peer(silent_ns=QUIET), COMPUTER, False),
        (peer(since_ns=BRIEF), GCS, True),
        (peer(since_ns=BRIEF), COMPUTER, True),
        (peer(COMPUTER), GCS, True),
        (peer(COMPUTER), COMPUTER, False),
        (peer(COMPUTER, silent_ns=QUIET), COMPUTER, True),
        (Standing(heard_ns=NOW_NS), COMPUTER, True),
    ],
)
def test_a_place_is_given_up_to_whom_has_precedence(served, kind, yields):
    assert (displaced(newcomer(kind), {"it": served}, NOW_NS) == "it") is yields


def test_nobody_yields_to_a_newcomer_that_sent_no_heartbeat():
    asking = Standing()
    asking.hear([common.MAVLink_timesync_message(0, 1)], NOW_NS)
    assert displaced(asking, {"it": peer(silent_ns=QUIET)}, NOW_NS) is None


def test_the_weakest_goes_first_whatever_the_order():
    peers = {
        "computer that comes and goes": peer(COMPUTER, since_ns=BRIEF),
        "silent computer": peer(COMPUTER, silent_ns=2 * QUIET),
        "computer": peer(COMPUTER, silent_ns=QUIET),
        "station that comes and goes": peer(since_ns=BRIEF),
        "silent station": peer(silent_ns=2 * QUIET),
        "station": peer(silent_ns=QUIET),
    }
    for order in itertools.permutations(peers):
        left = {name: peers[name] for name in order}
        gone = []
        while (loser := displaced(newcomer(), left, NOW_NS)) is not None:
            gone.append(loser)
            del left[loser]
        assert gone == list(peers)
