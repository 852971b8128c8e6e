"""Late copies of commands for a mode, and how long a command is taken for one."""

import time

import pytest
from pymavlink.dialects.v20 import common

from robotctl.mavlink.guards.command_dedup import CONFIRMED_REPEAT_NS, LateCopies
from robotctl.messages.control import Ack, Arm, Mode, SetMode
from robotctl.messages.mavlink_port import Peer

ARM = common.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = common.MAV_CMD_DO_SET_MODE
ACCEPTED, BUSY = common.MAV_RESULT_ACCEPTED, common.MAV_RESULT_TEMPORARILY_REJECTED
DENIED = common.MAV_RESULT_DENIED


def results(bench):
    return [ack.result for ack in bench.messages("COMMAND_ACK")]


def take_mode(bench, number, mode, **command):
    """Ask for a mode that navigation takes at once."""
    bench.command(SET_MODE, 1, number, **command)
    (request,) = bench.step()
    assert request.mode is mode
    bench.step(bench.navigation(mode=mode))
    assert results(bench) == [ACCEPTED]


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.HOLD])
def test_a_late_copy_of_a_mode_does_not_drive_off_after_hold(bench, mode):
    take_mode(bench, mode.value, mode)
    take_mode(bench, 4, Mode.HOLD)
    bench.command(SET_MODE, 1, mode.value)
    assert bench.step(bench.navigation(mode=Mode.HOLD)) == []
    sent = bench.take()
    assert [m.result for m, _ in sent if m.get_type() == "COMMAND_ACK"] == [BUSY]
    texts = [m.text for m, _ in sent if m.get_type() == "STATUSTEXT"]
    assert texts == [f"Mode {mode.name}: asked for a moment ago, ask again"]


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.HOLD])
def test_a_mode_hold_and_the_mode_again_are_three_wishes_by_their_numbers(bench, mode):
    take_mode(bench, mode.value, mode, sequence=7)
    take_mode(bench, 4, Mode.HOLD, sequence=8)
    take_mode(bench, mode.value, mode, sequence=9)
    take_mode(bench, 4, Mode.HOLD, sequence=10)
    for sequence in (7, 9):  # frames that the network brings again
        bench.command(SET_MODE, 1, mode.value, sequence=sequence)
        assert bench.step(bench.navigation(mode=Mode.HOLD)) == []
        assert results(bench) == [BUSY]


def test_what_a_station_repeats_by_itself_is_no_wish_against_another_ones_hold(bench):
    """MAVSDK sends what was not answered again after 0.5 s, by a new frame."""
    take_mode(bench, 10, Mode.AUTO, sequence=7)
    take_mode(bench, 4, Mode.HOLD, system=254, sequence=3)
    bench.command(SET_MODE, 1, 10, sequence=8)
    assert bench.step(bench.navigation(mode=Mode.HOLD)) == []
    assert results(bench) == [BUSY]


@pytest.mark.parametrize("confirmation", [0, 1], ids=["", "as mavros does"])
def test_arming_disarming_and_arming_again_are_three_wishes_by_their_numbers(bench, confirmation):
    """arming_cb in mavros/src/plugins/command.cpp has confirmation 1 in each request."""
    for sequence, wanted in enumerate((1, 0, 1, 0)):
        bench.command(ARM, wanted, sequence=sequence, confirmation=confirmation)
        (request,) = bench.step(bench.control())
        assert (type(request), request.arm) == (Arm, bool(wanted))
        bench.step(bench.control(acks=(Ack(request.request_id, accepted=True),)))
        assert results(bench) == [ACCEPTED]
    bench.command(ARM, 1, sequence=2)
    assert bench.step(bench.control()) == []
    assert results(bench) == [BUSY]


@pytest.mark.parametrize("end", [{"mission_completed": True}, {"mission_failed": True}])
def test_a_late_copy_of_auto_does_not_start_an_ended_mission_anew(bench, end):
    take_mode(bench, 10, Mode.AUTO)
    bench.step(bench.navigation(mode=Mode.AUTO, **end))
    bench.command(SET_MODE, 1, 10, peer=Peer(0, 9))
    assert bench.step() == []
    assert results(bench) == [BUSY]


def test_a_copy_of_a_mode_that_still_holds_gets_the_same_answer(bench):
    """That a mission was completed before says nothing about GUIDED."""
    take_mode(bench, 15, Mode.GUIDED)
    bench.step(bench.navigation(mode=Mode.GUIDED, mission_completed=True))
    bench.command(SET_MODE, 1, 15, confirmation=1)
    assert bench.step() == []
    assert results(bench) == [ACCEPTED]


def test_a_copy_of_a_mode_that_hold_has_replaced_is_not_carried_out(bench):
    bench.command(SET_MODE, 1, 10)
    bench.command(SET_MODE, 1, 4, system=254)
    bench.command(SET_MODE, 1, 10)
    assert [request.mode for request in bench.step()] == [Mode.AUTO, Mode.HOLD]
    bench.step(bench.navigation(mode=Mode.HOLD))
    assert results(bench) == [BUSY, BUSY, ACCEPTED]


def test_auto_asked_for_anew_after_a_completed_mission_is_carried_out(bench):
    take_mode(bench, 10, Mode.AUTO)
    bench.run(1.1)
    bench.step(bench.navigation(mode=Mode.AUTO, mission_completed=True))
    bench.take()
    take_mode(bench, 10, Mode.AUTO)


def test_another_station_may_ask_for_the_same_mode_at_once(bench):
    take_mode(bench, 10, Mode.AUTO)
    take_mode(bench, 4, Mode.HOLD)
    take_mode(bench, 10, Mode.AUTO, system=254)


def test_hold_is_carried_out_however_often_it_comes(bench):
    bench.command(SET_MODE, 1, 4)
    bench.command(SET_MODE, 1, 4, confirmation=1)
    assert [request.mode for request in bench.step()] == [Mode.HOLD, Mode.HOLD]
    bench.step(bench.navigation(mode=Mode.HOLD))
    assert results(bench) == [ACCEPTED]
    for confirmation in (0, 2):
        bench.command(SET_MODE, 1, 4, confirmation=confirmation)
        assert [request.mode for request in bench.step()] == [Mode.HOLD]
        bench.step(bench.navigation(mode=Mode.HOLD))
        assert results(bench) == [ACCEPTED]


def test_a_repeated_hold_does_not_put_off_the_word_that_it_was_not_taken(bench):
    for _ in range(4):
        bench.command(SET_MODE, 1, 4)
        bench.run(0.3)
    assert results(bench) == [BUSY]


def test_a_late_copy_of_the_old_set_mode_message_does_not_drive_off_after_hold(bench):
    bench.receive(common.MAVLink_set_mode_message(1, 1, 10))
    bench.step()
    bench.step(bench.navigation(mode=Mode.AUTO))
    take_mode(bench, 4, Mode.HOLD)
    bench.receive(common.MAVLink_set_mode_message(1, 1, 10))
    assert bench.step() == []
    bench.run(1.1)
    bench.receive(common.MAVLink_set_mode_message(1, 1, 10))
    assert [request.mode for request in bench.step()] == [Mode.AUTO]


@pytest.mark.parametrize(("after_s", "carried_out"), [(3.2, False), (5.1, True)])
def test_what_its_sender_repeats_for_want_of_an_answer_is_a_copy_for_longer(
    bench, after_s, carried_out
):
    """QGroundControl repeats after 3 s: mode and arming alike."""
    bench.command(ARM, 1)
    bench.step()
    bench.run(2.1)
    assert results(bench)[-1] == BUSY  # control has not answered
    take_mode(bench, 10, Mode.AUTO)
    bench.run(after_s)
    bench.take()
    bench.command(SET_MODE, 1, 10, confirmation=1)
    bench.command(ARM, 1, confirmation=1)
    requests = bench.step(bench.control(), bench.navigation(mode=Mode.HOLD))
    assert [type(each) for each in requests] == ([SetMode, Arm] if carried_out else [])
    assert results(bench) == ([] if carried_out else [BUSY, BUSY])


def test_a_copy_of_what_was_refused_is_refused_alike(bench):
    bench.command(ARM, 1)
    (request,) = bench.step()
    bench.step(bench.control(acks=(Ack(request.request_id, accepted=False),)))
    bench.command(ARM, 1)
    assert bench.step() == []
    assert results(bench) == [DENIED, DENIED]


def test_the_answer_to_a_copy_does_not_prolong_the_time_for_copies(bench):
    take_mode(bench, 10, Mode.AUTO)
    for _ in range(4):
        bench.command(SET_MODE, 1, 10)
        assert bench.step(bench.navigation(mode=Mode.HOLD), advance_s=0.24) == []
    bench.command(SET_MODE, 1, 10)
    assert [request.mode for request in bench.step(advance_s=0.1)] == [Mode.AUTO]


def test_answers_are_forgotten_without_a_look_at_all_the_others():
    """Whoever invents senders must not take the time in which a stop is waited for."""
    copies, begin_s = LateCopies(), time.process_time()
    for number in range(20_000):
        copies.remember((number % 250, number // 250), Mode.GUIDED, ACCEPTED, number)
    assert time.process_time() - begin_s < 2.0
    copies.remember((1, 1), Mode.GUIDED, ACCEPTED, CONFIRMED_REPEAT_NS)
    copies.remember((2, 1), Mode.GUIDED, ACCEPTED, 20_000 + CONFIRMED_REPEAT_NS)
    assert set(copies._answered) == {((1, 1), Mode.GUIDED), ((2, 1), Mode.GUIDED)}
