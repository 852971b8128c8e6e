"""Wishes that a link held back do not arm or drive a robot that was stopped meanwhile."""

import pytest
from pymavlink.dialects.v20 import common

from robotctl.mavlink.guards.stale_link import MAX_SENDERS, HeldBack
from robotctl.messages.control import Arm, EmergencyStop, Mode, SetMode
from robotctl.messages.mavlink_port import Peer

ARM, SET_MODE = common.MAV_CMD_COMPONENT_ARM_DISARM, common.MAV_CMD_DO_SET_MODE
BUSY = common.MAV_RESULT_TEMPORARILY_REJECTED
MANUAL, HOLD, AUTO = Mode.MANUAL.value, Mode.HOLD.value, Mode.AUTO.value


def heartbeat():
    return common.MAVLink_heartbeat_message(common.MAV_TYPE_GCS, 8, 0, 0, 4, 3)


def send_heartbeats(bench, count=5, period_s=1.0, **source):
    for _ in range(count):
        bench.receive(heartbeat(), **source)
        bench.run(period_s)


def wishes(requests):
    return [request for request in requests if isinstance(request, Arm | SetMode | EmergencyStop)]


@pytest.mark.parametrize("before", [0, 1, 4], ids=lambda count: f"behind {count} heartbeats")
def test_what_a_stalled_link_held_back_is_refused_with_the_reason(bench, before):
    send_heartbeats(bench)
    bench.run(5.0)
    bench.take()
    for _ in range(before):
        bench.receive(heartbeat())
    bench.command(ARM, 1)
    bench.command(SET_MODE, 1, AUTO)
    bench.receive(heartbeat())
    bench.receive(common.MAVLink_set_mode_message(1, 1, MANUAL))
    assert wishes(bench.run(0.9)) == []
    sent = bench.take()
    results = [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"]
    assert results == [BUSY, BUSY]
    said = "".join(m.text for m, _ in sent if m.get_type() == "STATUSTEXT")
    for wish in ("Arm", "Mode AUTO", "Mode MANUAL"):
        assert f"{wish}: the link was away for 6.0 s, this may be from before: ask again" in said


def test_who_asks_again_is_heard(bench):
    send_heartbeats(bench)
    bench.run(9.0)
    bench.command(ARM, 1)
    assert wishes(bench.run(1.1)) == []
    bench.command(ARM, 1)
    (request,) = wishes(bench.run(0.1))
    assert request.arm


def test_what_stops_the_robot_is_never_too_old(bench):
    send_heartbeats(bench)
    bench.run(9.0)
    bench.command(ARM, 0, 21196)
    bench.command(ARM, 0)
    bench.command(SET_MODE, 1, HOLD)
    stop, disarm, hold = wishes(bench.run(0.1))
    assert isinstance(stop, EmergencyStop)
    assert isinstance(disarm, Arm)
    assert not disarm.arm
    assert hold.mode is Mode.HOLD


@pytest.mark.parametrize(
    ("period_s", "silent_s", "peer"),
    [
        (1.0, 1.4, Peer(0, 0)),  # one heartbeat was lost
        (1.0, 60.0, Peer(0, 1)),  # a new connection has held nothing back
        (2.0, 9.0, Peer(0, 0)),  # its heartbeats say nothing
    ],
    ids=["one lost", "new connection", "not regular"],
)
def test_other_silence_refuses_nothing(bench, period_s, silent_s, peer):
    send_heartbeats(bench, period_s=period_s)
    bench.run(silent_s)
    bench.command(ARM, 1, peer=peer)
    bench.command(SET_MODE, 1, AUTO, peer=peer)
    assert len(wishes(bench.run(0.1))) == 2


def test_each_sender_is_judged_by_its_own_heartbeats(bench):
    send_heartbeats(bench, system=255)
    for _ in range(9):
        send_heartbeats(bench, 1, system=254)
    bench.command(ARM, 1, system=254)
    assert len(wishes(bench.run(0.1))) == 1


def test_invented_senders_do_not_fill_the_memory():
    held_back = HeldBack()
    for number in range(1000):
        held_back.hear(Peer(0, number), (255, 190), number)
    assert len(held_back._senders) == MAX_SENDERS
