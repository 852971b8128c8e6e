"""DO_SET_REVERSE: asked of navigation, acknowledged when that has taken it."""

import math

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.dialect import additions
from robotctl.messages.control import Mode, SetReverse

REVERSE = m.MAV_CMD_DO_SET_REVERSE
ACCEPTED, DENIED, LATER = (
    m.MAV_RESULT_ACCEPTED,
    m.MAV_RESULT_DENIED,
    m.MAV_RESULT_TEMPORARILY_REJECTED,
)


def results(bench):
    return [ack.result for ack in bench.messages("COMMAND_ACK")]


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.GUIDED])
@pytest.mark.parametrize("reverse", [True, False])
def test_it_is_accepted_when_navigation_has_taken_it(bench, mode, reverse):
    bench.command(REVERSE, float(reverse), *[math.nan] * 6)
    before = bench.navigation(mode=mode, reverse=reverse)  # no later than the request
    assert bench.step(bench.control(), before) == [SetReverse(bench.now_ns, reverse)]
    assert bench.step(bench.navigation(mode=mode, reverse=not reverse)) == []
    assert results(bench) == []
    bench.step(bench.navigation(mode=mode, reverse=reverse))
    assert results(bench) == [ACCEPTED]


def test_navigations_reason_is_told_where_it_refuses(bench):
    bench.step(bench.navigation(mode=Mode.GUIDED))
    bench.command(REVERSE, 1)
    bench.step(bench.navigation(mode=Mode.GUIDED))
    for _ in range(60):
        bench.step(bench.navigation(mode=Mode.GUIDED, message="refused: no sonar looks back"))
    sent = [each for each, _ in bench.take()]
    assert [each.result for each in sent if each.get_type() == "COMMAND_ACK"] == [LATER]
    texts = "".join(each.text for each in sent if each.get_type() == "STATUSTEXT")
    assert "no sonar looks back" in texts


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.MANUAL, Mode.RTL])
def test_in_other_modes_it_is_rejected_but_ahead_is_always_taken(bench, mode):
    bench.step(bench.navigation(mode=mode))
    bench.command(REVERSE, 1)
    assert bench.step(bench.navigation(mode=mode)) == []
    assert results(bench) == [LATER]
    bench.command(REVERSE, 0)
    assert len(bench.step(bench.navigation(mode=mode))) == 1
    bench.step(bench.navigation(mode=mode))
    assert results(bench) == [ACCEPTED]


@pytest.mark.parametrize("param", [2.0, 0.5, -1.0, math.nan, math.inf])
def test_neither_ahead_nor_reverse_is_denied(bench, param):
    bench.step(bench.navigation(mode=Mode.GUIDED))
    bench.command(REVERSE, param)
    assert bench.step(bench.navigation(mode=Mode.GUIDED)) == []
    assert results(bench) == [DENIED]


def test_it_is_asked_for_once_and_another_has_to_wait(bench):
    bench.step(bench.navigation(mode=Mode.AUTO))
    bench.command(REVERSE, 1)
    bench.command(REVERSE, 1, confirmation=1)
    bench.command(REVERSE, 0, system=254)
    assert len(bench.step(bench.navigation(mode=Mode.AUTO))) == 1
    assert results(bench) == [LATER]
    bench.step(bench.navigation(mode=Mode.AUTO, reverse=True))
    assert results(bench) == [ACCEPTED]


def test_taking_it_back_asks_for_what_was_before(bench):
    bench.step(bench.navigation(mode=Mode.AUTO))
    bench.command(REVERSE, 1)
    bench.step(bench.navigation(mode=Mode.AUTO))
    bench.receive(additions.MAVLink_command_cancel_message(1, 1, REVERSE))
    requests = bench.step(bench.navigation(mode=Mode.AUTO))
    assert requests == [SetReverse(bench.now_ns, False)]
    assert results(bench) == [additions.MAV_RESULT_CANCELLED]
