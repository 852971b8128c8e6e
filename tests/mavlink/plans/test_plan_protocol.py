"""Missions, fences and rally points: each order of messages, of one station and of two."""

import random
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.messages.mavlink_port import Peer
from tests.mavlink.plans.exchange import FENCE, MISSION, RALLY, Exchange

MESSAGES = (
    *(("count", count) for count in (0, 1, 2, 3, 1001)),
    *((word,) for word in ("right", "wrong", "again", "bad", "old", "clear", "list")),
    *(("request", seq) for seq in (0, 1, 9)),
    *(("partial", first, last) for first, last in ((0, 0), (1, 1), (2, 1))),
    *(("ack", result) for result in (0, 1, 14, 15)),
)
"""A station's words, as `Exchange.say` takes them."""
BOTH = [*product("ab", MESSAGES)]


def all_pairs(words, rng):
    """Return a cycle in which each word follows each other one, and itself: Hierholzer's."""
    left = {word: rng.sample(words, len(words)) for word in words}
    path, cycle = [words[0]], []
    while path:
        if left[path[-1]]:
            path.append(left[path[-1]].pop())
        else:
            cycle.append(path.pop())
    return cycle[::-1]


CASES = [
    (MISSION, "ardupilot", False), (MISSION, "ardupilot", True), (MISSION, "px4", False),
    (MISSION, "generic", True), (FENCE, "ardupilot", True), (RALLY, "px4", False),
]  # fmt: skip


GAPS_MS = {"at once": (0, 20), "apart": (20, 40, 80), "late": (80, 2000, 9000)}
"""Pauses between messages: several in a step, before navigation answers, and time-outs."""


def walk(exchange, words, gaps, rng):
    """Let stations say words, and all that is under way end."""
    for station, word in words:
        exchange.say(station, *word)
        exchange.wait(rng.choice(GAPS_MS[gaps]))
    exchange.settle()


@pytest.mark.parametrize("gaps", GAPS_MS)
@pytest.mark.parametrize(("kind", "personality", "drives"), CASES)
def test_each_two_messages_of_two_stations_are_answered_as_the_protocol_says(
    kind, personality, drives, gaps
):
    rng = random.Random(f"{kind} {personality} {drives} {gaps}")
    exchange = Exchange(kind, personality, drives=drives)
    walk(exchange, all_pairs(BOTH, rng), gaps, rng)


@settings(max_examples=60)
@given(
    st.sampled_from(CASES), st.lists(st.sampled_from(BOTH), max_size=12),
    st.sampled_from(sorted(GAPS_MS)), st.randoms(use_true_random=False),
)  # fmt: skip
def test_any_order_of_messages_is_answered_so_and_ends(case, words, gaps, rng):
    kind, personality, drives = case
    exchange = Exchange(kind, personality, drives=drives)
    walk(exchange, words, gaps, rng)
    is_refused = drives and kind == MISSION
    exchange.say("b", "count", 2)
    for _ in range(2):
        exchange.wait(20)
        exchange.say("b", "right")
    exchange.settle()
    assert len(exchange.plan) == (0 if is_refused else 2 - exchange.homes)


def test_between_them_all_messages_come_in_all_states():
    seen = set()
    for seed, gaps in enumerate(["apart", *["at once"] * 5]):
        rng, exchange = random.Random(seed), Exchange()
        walk(exchange, all_pairs(BOTH, rng), gaps, rng)
        seen |= exchange.visited
    expected = {*product(["idle", "receiving", "waiting", "deciding"], BOTH)}
    assert seen == expected


def answers(exchange, *words, station="a", gap_ms=80):
    """Let a station say words; return the kind and the value of all that it is told."""
    told = []
    exchange.heard = lambda said: told.extend((kind, value[0]) for who, kind, *value in said)
    for word in words:
        exchange.say(station, *word)
        exchange.wait(gap_ms)
    exchange.wait(2000)
    return told


REQUEST, ACK = "REQUEST", "ACK"
ACCEPTED, DENIED = 0, 14


def test_a_count_right_behind_a_clear_is_served_after_it():
    """dronekit's `commands.upload`: it waits without end for the requests."""
    exchange = Exchange()
    exchange.say("a", "clear")
    told = answers(exchange, ("count", 2), ("right",), ("right",))
    assert told == [(ACK, ACCEPTED), (REQUEST, 0), (REQUEST, 1), (ACK, ACCEPTED)]
    assert len(exchange.plan) == 1


def test_who_lists_right_behind_an_upload_is_told_of_that():
    """dronekit's `commands.download` behind `upload`, which does not wait for the answer."""
    exchange = Exchange()
    answers(exchange, ("count", 3), ("right",), ("right",))
    exchange.say("a", "right")
    assert answers(exchange, ("list",)) == [(ACK, ACCEPTED), ("COUNT", 3)]


def test_a_mission_of_home_alone_is_asked_for_and_leaves_none():
    """MAVSDK's `clear_mission` for ArduPilot."""
    exchange = Exchange()
    answers(exchange, ("count", 2), ("right",), ("right",))
    assert len(exchange.plan) == 1
    assert answers(exchange, ("count", 1), ("right",)) == [(REQUEST, 0), (ACK, ACCEPTED)]
    assert exchange.plan == ()


def test_a_repeated_last_item_gets_the_answer_to_its_own_upload():
    exchange = Exchange(FENCE)
    assert answers(exchange, ("count", 1), ("right",))[-1] == (ACK, ACCEPTED)
    assert answers(exchange, ("again",)) == [(ACK, ACCEPTED)]
    assert answers(exchange, ("count", 1), ("bad",)) == [(REQUEST, 0), (ACK, 12)]
    assert answers(exchange, ("again",)) == [(ACK, 12)]
    exchange = Exchange(drives=True)  # AUTO drives: navigation refuses, but only after a while
    told = answers(exchange, ("count", 2), ("right",), ("right",), ("again",), ("again",))
    assert told == [(REQUEST, 0), (REQUEST, 1), (ACK, DENIED)]
    assert answers(exchange, ("again",)) == [(ACK, DENIED)]


@pytest.mark.parametrize("result", range(1, 16))
def test_an_error_of_the_station_ends_its_upload_at_once(result):
    exchange = Exchange()
    answers(exchange, ("count", 3), ("right",))
    assert answers(exchange, ("ack", result)) == []
    exchange.wait(10_000)  # nothing is asked for any more: `step` compares
    assert answers(exchange, ("count", 1), station="b")[0] == (REQUEST, 0)


def test_who_reads_a_plan_reads_one_though_another_station_changes_it():
    exchange = Exchange(RALLY)
    answers(exchange, ("count", 2), ("right",), ("right",))
    answers(exchange, ("list",), ("request", 0), station="b")
    answers(exchange, ("count", 1), ("right",))
    assert answers(exchange, ("request", 1), station="b") == [("ITEM", 1)]
    assert answers(exchange, ("ack", ACCEPTED), ("request", 1), station="b") == [(ACK, 13)]


def test_all_kinds_are_cleared_with_one_answer_which_is_the_refusal_if_there_is_one(bench):
    everything = m.MAVLink_mission_clear_all_message(1, 1, m.MAV_MISSION_TYPE_ALL)

    def told():
        for _ in range(100):
            bench.step(bench.control(), bench.navigation())
        acks = [each for each, to in bench.take("MISSION_ACK") if to == Peer(0, 0)]
        return [(each.type, each.mission_type) for each in acks]

    bench.receive(everything)
    assert told() == [(ACCEPTED, m.MAV_MISSION_TYPE_ALL)]
    bench.receive(m.MAVLink_mission_count_message(1, 1, 3, FENCE), system=254, peer=Peer(0, 1))
    bench.receive(everything)
    assert told() == [(DENIED, m.MAV_MISSION_TYPE_ALL)]


def test_an_acknowledgement_of_an_unknown_kind_is_not_answered(bench):
    bench.receive(m.MAVLink_mission_ack_message(1, 1, 0, 77))
    bench.step(bench.control())
    assert bench.take("MISSION_ACK") == []
