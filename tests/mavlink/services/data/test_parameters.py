"""Parameters: a ground station's side of the protocol, over links that lose, repeat and reorder."""

import math
import random
import time
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as m

from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.services.data.parameters import AGAIN_NS
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import SafetyState
from robotctl.messages.mavlink_port import Peer
from robotctl.messages.tuning import Tuning
from tests.mavlink.conftest import Bench

REAL32, INT32 = m.MAV_PARAM_TYPE_REAL32, m.MAV_PARAM_TYPE_INT32
ACCEPTED = m.MAV_RESULT_ACCEPTED
CONFIG = load_robot(find_file("diff_drive"))
FIRST, SECOND = Peer(0, 0), Peer(1, 0)


class Store:
    """A disk that may refuse."""

    works = True
    values = None

    def save(self, values):
        if self.works:
            self.values = dict(values)
        return self.works


@pytest.fixture
def store():
    return Store()


def bench_with(store, links=2, wanted=()):
    bench = Bench(links)
    bench.parameters = ParameterSet(Configurations(CONFIG, CONFIG, contradictions), dict(wanted))
    bench.telemetry = Telemetry(
        CONFIG.mavlink,
        bench.robot,
        bench.links,
        parameters=bench.parameters,
        parameter_store=store,
    )
    return bench


@pytest.fixture
def bench(store):
    return bench_with(store)


def ask_list(bench, peer=FIRST):
    bench.receive(m.MAVLink_param_request_list_message(1, 1), peer=peer)


def read(name="", index=-1):
    return m.MAVLink_param_request_read_message(1, 1, name.encode(), index)


def put(name, value, kind=REAL32):
    return m.MAVLink_param_set_message(1, 1, name.encode(), value, kind)


def answers(bench, message, peer=FIRST):
    """Return what one message is answered to whom, without the streams."""
    bench.take()
    bench.receive(message, peer=peer)
    bench.step(bench.control())
    kinds = ("PARAM_VALUE", "PARAM_ERROR")
    return [(each, to) for each, to in bench.take() if each.get_type() in kinds]


def test_the_list_is_complete_in_order_and_paced(bench):
    count = len(bench.parameters.parameters)
    ask_list(bench)
    seen, steps = [], 0
    while len(seen) < count:
        bench.step(bench.control(), advance_s=0.01)
        new = bench.take("PARAM_VALUE")
        assert 0 < len(new) <= 8
        assert {to for _, to in new} == {FIRST}
        seen += [message for message, _ in new]
        steps += 1
    assert [each.param_index for each in seen] == list(range(count))
    assert {each.param_count for each in seen} == {count}
    assert steps / 100 <= 2.0 * count / 500
    by_name = {each.param_id: each for each in seen}
    assert by_name["CTL_L_KP"].param_value == pytest.approx(0.65)
    assert by_name["CTL_L_KP"].param_type == REAL32
    assert by_name["SAF_ARM_MS"].param_value == 1000.0  # C-cast, not byte-wise
    assert by_name["SAF_ARM_MS"].param_type == by_name["FS_GCS_HOLD"].param_type == INT32
    bench.run(0.5)
    assert bench.take("PARAM_VALUE") == []


@pytest.mark.parametrize("seed", range(3))
def test_the_list_is_complete_over_a_link_that_loses_repeats_and_reorders(bench, seed):
    """As ground stations do it: ask for the list, then for the gaps by index."""
    rng = random.Random(seed)
    count, seen, waiting = len(bench.parameters.parameters), {}, []
    asked = [m.MAVLink_param_request_list_message(1, 1)]
    for _ in range(20):
        for message in asked:
            for _ in range(rng.choice((0, 1, 1, 1, 2))):
                bench.receive(message)
        for _ in range(100):
            bench.step(bench.control(), advance_s=0.01)
            for message, _ in bench.take("PARAM_VALUE"):
                waiting += [message] * rng.choice((0, 1, 1, 1, 2))
            rng.shuffle(waiting)
            for _ in range(min(len(waiting), 5)):
                message = waiting.pop()
                seen[message.param_index] = message.param_id
        gaps = [index for index in range(count) if index not in seen]
        if not gaps:
            break
        asked = [read(index=index) for index in gaps[:10]] if seen else asked
    assert [seen[index] for index in range(count)] == [p.name for p in bench.parameters.parameters]


def test_two_ground_stations_list_at_the_same_time(bench):
    count = len(bench.parameters.parameters)
    ask_list(bench, FIRST)
    bench.step(bench.control())
    ask_list(bench, SECOND)
    bench.run(1.0)
    sent = bench.take("PARAM_VALUE")
    for peer in (FIRST, SECOND):
        assert [each.param_index for each, to in sent if to == peer] == list(range(count))


def test_a_parameter_is_read_by_name_and_by_index(bench):
    index = bench.parameters.index_of("LIM_V_MAX")
    for question in (read("LIM_V_MAX"), read(index=index), read("WRONG", index)):
        ((value, to),) = answers(bench, question, SECOND)
        assert (value.param_id, value.param_index, to) == ("LIM_V_MAX", index, SECOND)
    for question in (read("LIM_V_MAXX"), read(index=5000), read(index=-2)):
        ((error, to),) = answers(bench, question, SECOND)
        assert (error.get_type(), error.error, to) == ("PARAM_ERROR", 1, SECOND)


def test_a_set_value_is_kept_then_told_to_everybody_and_logged(bench, store):
    found = answers(bench, put("CTL_L_KP", 0.7))
    assert store.values == {"control.left.kp": 0.7}
    assert {to for _, to in found} == {FIRST, SECOND}
    assert [each.param_value for each, _ in found] == pytest.approx([0.7, 0.7])
    (notice,) = bench.telemetry.take_notices()
    assert notice.text == "Parameter CTL_L_KP: 0.65 -> 0.7"
    # Repeated, because the answer was lost: answered to who asks, and nothing else.
    store.values = None
    ((again, to),) = answers(bench, put("CTL_L_KP", 0.7))
    assert (again.param_value, to) == (pytest.approx(0.7), FIRST)
    assert store.values is None
    assert bench.telemetry.take_notices() == []


def test_a_value_that_is_set_again_later_is_told_to_everybody(bench, store):
    found = answers(bench, put("CTL_L_KP", CONFIG.control.left.kp), SECOND)
    assert {to for _, to in found} == {FIRST, SECOND}
    bench.run(0.5)
    for _ in range(20):  # but not again and again
        ((_, to),) = answers(bench, put("CTL_L_KP", CONFIG.control.left.kp), SECOND)
        assert to == SECOND
    bench.run(1.5)
    assert len(answers(bench, put("CTL_L_KP", CONFIG.control.left.kp), FIRST)) == 2
    assert store.values is None


@pytest.mark.parametrize("flood", [put("CTL_L_KPP", 1.0), put("CTL_L_KP", -1.0)])
def test_a_flood_of_what_is_refused_says_nothing_to_others_and_little_to_its_sender(bench, flood):
    begin_s, errors, texts = time.process_time(), 0, Counter()
    for _ in range(100):
        for _ in range(10):
            bench.receive(flood, peer=SECOND)
        bench.step(bench.control(), advance_s=0.01)
        for message, to in bench.take():
            errors += message.get_type() == "PARAM_ERROR" and to == SECOND
            texts[to] += message.get_type() == "STATUSTEXT"
    assert errors == 1000
    assert texts[FIRST] == 0
    assert 1 <= texts[SECOND] <= 50  # in chunks
    assert len(bench.telemetry.take_notices()) <= 25
    assert time.process_time() - begin_s < 3.0  # 0.5 s; difflib alone takes 3 ms each
    bench.run(20.0, rate_hz=5)
    bench.take()
    bench.receive(flood, peer=SECOND)
    bench.run(0.1)
    assert bench.take("STATUSTEXT")


def test_a_flood_of_values_is_saved_now_and_then_and_leaves_others_their_turn(bench, store):
    saves = []
    store.save = lambda values: saves.append(dict(values)) or True
    for number in range(100):
        for each in range(50):
            bench.receive(put("CTL_L_KP", 1.0 + (number + each) % 7), peer=SECOND)
        if number == 50:
            bench.receive(put("CTL_R_KP", 2.0), peer=FIRST)
        bench.step(bench.control(), advance_s=0.01)
    assert len(saves) <= 21
    assert saves[-1]["control.right.kp"] == 2.0


def test_values_set_together_are_saved_once(bench, store):
    saves = []
    store.save = lambda values: saves.append(dict(values)) or True
    for name in ("CTL_L_KP", "CTL_R_KP", "CTL_L_KI"):
        bench.receive(put(name, 1.0))
    bench.step(bench.control())
    assert saves == [{"control.left.kp": 1.0, "control.right.kp": 1.0, "control.left.ki": 1.0}]


def test_a_disk_that_takes_nothing_is_said(bench, store):
    store.works = False
    answers(bench, put("CTL_L_KP", 0.7))
    texts = [notice.text for notice in bench.telemetry.take_notices()]
    assert "Parameters cannot be saved, a restart will lose them" in texts


@pytest.mark.parametrize(
    ("message", "error", "says"),
    [
        (put("CTL_L_KPP", 1.0), 1, "Parameter CTL_L_KPP: unknown; did you mean CTL_L_KP?"),
        (put("CTL_L_KP", 1e6), 2, "Parameter CTL_L_KP: 1e+06 found, 0 to 100 allowed"),
        (put("CTL_L_KP", math.nan), 2, "Parameter CTL_L_KP: nan is no number"),
        (put("CTL_L_KP", math.inf), 2, "Parameter CTL_L_KP: inf is no number"),
        (
            put("CTL_L_KP", 1.0, m.MAV_PARAM_TYPE_REAL64),
            6,
            "Parameter CTL_L_KP: type 10 found, no parameter is of that; 9 allowed",
        ),
        (
            put("SAF_ARM_MS", 1000, m.MAV_PARAM_TYPE_UINT8),
            6,
            "Parameter SAF_ARM_MS: type 1 found, no parameter is of that; 6 allowed",
        ),
        (put("CTL_L_KP", 1.0, INT32), 7, "Parameter CTL_L_KP: type 6 found, 9 allowed"),
        (put("SAF_ARM_MS", 1.5), 7, "Parameter SAF_ARM_MS: 1.5 found, a whole number allowed"),
        (put("GEO_TRACK", 0.4), 5, "Parameter GEO_TRACK stands in the robot's file only"),
    ],
)
def test_what_is_refused_is_answered_to_the_sender_with_the_reason(
    bench, store, message, error, says
):
    found = answers(bench, message, SECOND)
    assert {to for _, to in found} == {SECOND}
    assert found[0][0].error == error
    for value, _ in found[1:]:  # for those that know no PARAM_ERROR: the unchanged value
        parameter = bench.parameters.parameters[value.param_index]
        assert value.param_value == pytest.approx(bench.parameters.value(parameter))
    assert (len(found) == 2) == (error != 1)
    assert [notice.text for notice in bench.telemetry.take_notices()] == [says]
    assert store.values is None


class Process:
    """Control or navigation, as far as tuning goes."""

    number = 0

    def take(self, requests):
        for request in requests:
            if isinstance(request, Tuning):
                self.number = request.number
                self.values = request.values


def test_control_and_navigation_are_sent_what_they_have_not_taken(bench):
    control, navigation = Process(), Process()

    def run(seconds, *reached):
        for _ in range(round(50 * seconds)):
            states = (
                bench.control(tuning=control.number),
                bench.navigation(tuning=navigation.number),
            )
            requests = bench.step(*states)
            for process in reached:
                process.take(requests)

    bench.receive(put("CTL_L_KP", 0.7))
    run(1.0, control)
    assert control.values == {"control.left.kp": 0.7}
    run(1.0, control)
    texts = [notice.text for notice in bench.telemetry.take_notices()]
    assert texts[1:] == ["Parameters: not taken yet by navigation"]
    run(1.0, control, navigation)
    assert navigation.number == control.number != 0
    control.number = 0  # a new process
    run(2 * AGAIN_NS * 1e-9, control, navigation)
    assert control.number == navigation.number
    bench.receive(put("CTL_L_KP", 0.65))
    run(2 * AGAIN_NS * 1e-9, control, navigation)
    assert (control.number, control.values) == (0, {})


def test_a_rate_changes_for_who_has_not_asked_for_another(bench):
    bench.run(1.0)
    interval = m.MAV_CMD_SET_MESSAGE_INTERVAL
    bench.command(interval, m.MAVLINK_MSG_ID_ATTITUDE, 1e6 / 4.0, peer=SECOND)
    bench.run(0.5)
    bench.receive(put("MSG_ATTITUDE", 25.0))
    bench.run(0.5)
    bench.take()
    bench.run(2.0)
    sent = [to for _, to in bench.take("ATTITUDE")]
    assert sent.count(FIRST) == pytest.approx(50, abs=1)
    assert sent.count(SECOND) == pytest.approx(8, abs=1)


NAMES = st.sampled_from(["CTL_L_KP", "LIM_V_MAX", "SAF_ARM_MS", "GEO_TRACK", "NONE"])
MESSAGES = st.one_of(
    st.builds(put, NAMES, st.floats(width=32), st.integers(0, 255)),
    st.builds(read, NAMES, st.integers(-32768, 32767)),
    st.builds(lambda raw: m.MAVLink_param_set_message(1, 1, raw, 1.0, 9), st.binary(max_size=16)),
    st.builds(m.MAVLink_param_request_list_message, st.just(1), st.just(1)),
)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(MESSAGES, st.sampled_from([FIRST, SECOND])), max_size=20))
def test_whatever_comes_each_set_and_read_is_answered_and_the_robot_could_start(messages):
    store = Store()
    bench = bench_with(store)
    for message, peer in messages:
        found = answers(bench, message, peer)
        if message.get_type() != "PARAM_REQUEST_LIST":
            assert any(to == peer for _, to in found)
    assert not list(contradictions(bench.parameters.now))
    assert (store.values or {}) == bench.parameters.changes()


def commanded(bench, number, *params, state=SafetyState.STANDBY):
    """Return the result of a command and the last values in force that are sent."""
    bench.take()
    bench.command(number, *params)
    requests = bench.step(bench.control(state=state))
    requests += bench.step(bench.control(state=state), advance_s=AGAIN_NS / 1e9)
    (ack,) = bench.messages("COMMAND_ACK")
    tunings = [each for each in requests if isinstance(each, Tuning)]
    return ack.result, tunings[-1].values if tunings else None


def test_another_speed_is_in_force_at_once_and_is_not_kept(bench, store):
    key = "navigation.guided_speed_m_s"
    speed = m.MAV_CMD_DO_CHANGE_SPEED
    assert commanded(bench, speed, 1, 0.25, -1) == (ACCEPTED, {key: 0.25})
    (value,) = [each for each, _ in answers(bench, read("CRUISE_SPEED"))]
    assert value.param_value == pytest.approx(CONFIG.navigation.guided_speed_m_s)
    assert store.values is None
    for nonsense in (math.nan, -3.0, 1e9, 0.0):
        assert commanded(bench, speed, 1, nonsense)[0] == m.MAV_RESULT_DENIED
    assert commanded(bench, speed, 1, -2)[0] == ACCEPTED
    assert commanded(bench, speed, 0, -1) == (ACCEPTED, None)  # nothing differs any more


def test_storage_keeps_and_forgets_what_was_set(bench, store):
    answers(bench, put("CRUISE_SPEED", 0.3))
    storage, later = m.MAV_CMD_PREFLIGHT_STORAGE, m.MAV_RESULT_TEMPORARILY_REJECTED
    assert commanded(bench, storage, 1)[0] == ACCEPTED
    assert commanded(bench, storage, 2, state=SafetyState.ARMED)[0] == later
    assert store.values
    bench.take()
    bench.command(storage, 2)
    bench.step(bench.control())
    told = {each.param_id: each.param_value for each in bench.messages("PARAM_VALUE")}
    assert told == {"CRUISE_SPEED": pytest.approx(CONFIG.navigation.guided_speed_m_s)}
    assert store.values == {}
    store.works = False
    assert commanded(bench, storage, 1)[0] == m.MAV_RESULT_FAILED
    assert commanded(bench, storage, 0)[0] == m.MAV_RESULT_DENIED
